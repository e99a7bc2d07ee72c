"""Wearer's hips and knees: their normative moments, by phase and hip angle."""

from collections.abc import Mapping, Sequence
from functools import lru_cache
from itertools import groupby, pairwise

import numpy as np

from twin_gait.core.estimation import new_delay_line
from twin_gait.exceptions import ParameterError
from twin_gait.experiment.experiment import Experiment
from twin_gait.gait.table import TICK, GaitTable
from twin_gait.leg_model.leg_model import LegModel
from twin_gait.measures.reference import FASTEST, SLOWEST, normative_moment, reference_curve
from twin_gait.parameters.wearer import WEARER_JOINTS, JointCondition, Patient
from twin_gait.simulation.episode import HIP_ANGLE_STEP, MIN_HIP_ANGLE, Limb
from twin_gait.simulation.record import pad_phases
from twin_gait.vocabulary import JointName
from twin_gait.worlds.world import Walking

# Instants of healthy walking in [%] of the cycle (J. Perry: Gait analysis, Slack, 1992). The first two are
# begin and end of stance and of swing; the others divide them, the coarsest division first: rise of the heel,
# toe-off and landing of the other foot (between terminal stance and pre-swing); end of initial and mid swing.
_STANCE_EVENTS = (0.0, 62.0, 31.0, 12.0, 50.0)
_SWING_EVENTS = (62.0, 100.0, 75.0, 87.0)
N_HIP_ANGLES = 41  # Number of hip angles of the normative moments.
_EFFORT_CAPACITY = 256  # Efforts with a delay below this number of ticks share a compiled loop.
_SAMPLES = 51  # Number of samples of the reference curve in a phase.


def limbs_of(experiment: Experiment, table: GaitTable, model: LegModel) -> list[Limb]:
    """Return hips and knees of the wearer, leg by leg; all moments are 0 if the wearer makes no effort.

    Raises ParameterError if the wearer makes an effort and the cycle of the table is not a stride.
    """
    patient = experiment.patient or Patient()
    keys = [(side, joint) for side in model.sides for joint in WEARER_JOINTS]
    conditions = [patient.conditions.get(key, JointCondition()) for key in keys]
    spans = phase_spans(table) if any(item.effort * item.strength for item in conditions) else {}
    return [
        Limb(
            model.index(*key),
            item,
            pad_phases(_moments(patient, experiment.scenario.walking, table, spans, key[1]).tolist()),
            new_delay_line(round(patient.effort_delay / TICK), capacity_step=_EFFORT_CAPACITY),
            experiment.sides.index(key[0]) if key[0] in experiment.sides else 0,
        )
        for key, item in zip(keys, conditions, strict=True)
    ]


def phase_spans(table: GaitTable) -> dict[str, tuple[float, float]]:
    """Assign spans of the healthy gait cycle to the phases of a table, by their order in its cycle.

    The phases of stance divide it at the events of Perry's cycle, and the phases of swing likewise: two
    phases of stance meet where the heel rises, the boundaries of three are the rise of the heel and the
    toe-off of the other foot, and a fourth begins where the other foot lands. If there are more phases than
    events, the longest span is halved. The cycle is the first one of the table, or all phases in their order.
    A phase of swing outside of the cycle begins a walk and has the span of the first swing phase.

    Returns the first and last instant in [%] of the cycle by phase, without the phases of stance outside of
    the cycle, in which the wearer stands still. Raises ParameterError if the cycle has no stance or no swing.
    """
    cycle = table.cycles[0] if table.cycles else table.phase_names
    begins = [i for i in range(len(cycle)) if table.is_swing(cycle[i - 1]) and not table.is_swing(cycle[i])]
    if not begins:
        raise ParameterError(
            f"patient.effort: gait table {table.name!r}: its cycle {', '.join(cycle)} is no stride of stance "
            "and swing; a phase is of swing if its name has 'swing' in it and scaling.stance_phases does not "
            "name it: rename a phase, or set the effort to 0"
        )
    spans: dict[str, tuple[float, float]] = {}
    for swings, run in groupby((*cycle[begins[0] :], *cycle[: begins[0]]), table.is_swing):
        phases = list(run)
        cuts = _cuts(_SWING_EVENTS if swings else _STANCE_EVENTS, len(phases))
        spans |= dict(zip(phases, pairwise(cuts), strict=True))
    first = next(span for phase, span in spans.items() if table.is_swing(phase))
    return {name: first for name in table.phase_names if table.is_swing(name)} | spans


def _cuts(events: Sequence[float], phases: int) -> list[float]:
    cuts = sorted(events[: phases + 1])
    while len(cuts) <= phases:
        longest = int(np.diff(cuts).argmax())
        cuts.insert(longest + 1, 0.5 * (cuts[longest] + cuts[longest + 1]))
    return cuts


def _moments(
    patient: Patient,
    walking: Walking | None,
    table: GaitTable,
    spans: Mapping[str, tuple[float, float]],
    joint: JointName,
) -> np.ndarray:
    """Return normative moments in [N·m] by phase and hip angle, shape ``(n_phases, POSTURES)``.

    The moment is that of the instant of the phase with the nearest hip angle. Stance moments are scaled by
    the carried share of the weight, swing moments are not. In phases without a span, in which the wearer
    stands still, they are 0, because the device alone supports the wearer.
    """
    speed, carried = SLOWEST, 0.0
    if walking is not None:
        speed, carried = min(max(walking.speed, SLOWEST), FASTEST), walking.carried_share
    rows = np.zeros((len(table.phases), N_HIP_ANGLES))
    for row, name in zip(rows, table.phase_names, strict=True):
        if name in spans:
            instants = _instants(spans[name], speed, patient.height)
            share = 1.0 if table.is_swing(name) else carried
            row[:] = share * patient.mass * normative_moment(joint, instants)
    return rows


@lru_cache(maxsize=64)
def _instants(span: tuple[float, float], speed: float, height: float) -> np.ndarray:
    """Return the instants of a span in [%] of the cycle at which the healthy hip is nearest to each angle.

    They are cached, because all limbs of a wearer and all tables of one wearer use the same instants.
    """
    percent = np.linspace(*span, _SAMPLES)
    hip = reference_curve(JointName.HIP, percent, speed=speed, height=height)
    postures = MIN_HIP_ANGLE + HIP_ANGLE_STEP * np.arange(N_HIP_ANGLES)
    found = np.asarray(percent[np.abs(hip[None, :] - postures[:, None]).argmin(axis=1)])
    found.setflags(write=False)  # the array is cached
    return found
