"""Does the spectral radius of the transition matrix predict instability? Checked against the engine.

Every case holds the bench leg at one posture with the same k, b and G in hip and knee. The transition
matrix (:mod:`twin_gait.checking.linear_loop`) predicts. The *linear run* is the compiled engine on the
same leg with friction replaced by its slope and a start 1e-5 rad away, judged before anything saturates. The
*true run* has the friction law, the limits and the stops, and starts 5° away.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable
from dataclasses import replace
from enum import StrEnum
from functools import cache
from typing import NamedTuple

import numpy as np

from twin_gait.checking.finding import Subject
from twin_gait.checking.hanging_leg import friction_slope, hanging_legs
from twin_gait.checking.linear_loop import LinearLoop, spectral_radius, transition_matrix
from twin_gait.configuration import load_experiment
from twin_gait.experiment import Experiment
from twin_gait.gait.table import GaitTable, JointImpedance, PhaseParameters
from twin_gait.parameters import FrictionParameters
from twin_gait.scenario import BenchLegScenario
from twin_gait.simulation import Run, RunStatus, simulate
from twin_gait.vocabulary import JointName, Side

STIFFNESSES = tuple(math.degrees(value) for value in (0.3, 1.0, 2.5, 6.0))  # [N m] / [rad]
DAMPINGS = (0.0, 10.0, 30.0, 90.0)  # [N m s] / [rad]
GAINS = (0.0, 0.2, 0.4, 0.5, 0.6, 0.7, 0.8, 1.0)
POSTURE = (math.radians(20.0), math.radians(40.0))  # hip and knee, far from the stops
VELOCITIES = (0.0, 1.0)  # [rad] / [s]; where the friction laws are linearised
LINEAR_START, TRUE_START = 1e-5, math.radians(5.0)  # [rad] away from the posture
DURATION = 10.0  # [s]
UNDECIDED = 0.005  # a spectral radius this close to 1 is left out

_HOLD = "hold"
_EARLY, _LATE = (2.0, 3.0), (9.0, 10.0)  # [s]; where the sizes of a linear motion are compared
_LARGE = 0.05  # [rad]; a linear motion that has come to this has grown, and is not linear any more
_ROUNDING = 1e-12  # [rad]; one that has come down to this has decayed
_BEFORE, _END = (5.0, 7.5), (7.5, 10.0)  # [s]; where the sizes of a true motion are compared
_STILL = math.radians(0.01)  # a true motion smaller than this is rest
_DIES = 0.8  # and so is one that has become smaller by this from one of the two spans to the other


class Ending(StrEnum):
    """What becomes of a true run."""

    REST = "rest"
    LIMIT_CYCLE = "limit cycle"
    RUNAWAY = "runaway"


class Case(NamedTuple):
    """One point of the grid, for hip and knee alike.

    Attributes:
        stiffness: k in [N m] / [rad].
        damping: b in [N m s] / [rad].
        gain: G.
    """

    stiffness: float
    damping: float
    gain: float


class LoopResult(NamedTuple):
    """What was predicted and what was seen of one case.

    Attributes:
        case: The case.
        radii: Predicted spectral radius at each of ``VELOCITIES``.
        grows: Whether the linear run grew, at each of ``VELOCITIES``.
        ending: What became of the true run.
        amplitude: Half the range of the joint that moves most at the end of the true run in [rad].
    """

    case: Case
    radii: tuple[float, ...]
    grows: tuple[bool, ...]
    ending: Ending
    amplitude: float

    def misses(self) -> int:
        """Velocities at which the prediction is clear and wrong."""
        pairs = zip(self.radii, self.grows, strict=True)
        return sum(abs(radius - 1.0) >= UNDECIDED and (radius > 1.0) != grew for radius, grew in pairs)


def grid() -> list[Case]:
    """All cases, in order."""
    return [Case(*values) for values in itertools.product(STIFFNESSES, DAMPINGS, GAINS)]


# ---------------------------------------------------------------------- experiments


def true_experiment(case: Case) -> Experiment:
    """Bench leg that holds one posture, with its friction, limits and stops.

    Args:
        case: k, b and G.

    Returns:
        The experiment; gravity is compensated as in the swing phases of the shipped tables.
    """
    base = load_experiment("bench_leg").experiment
    joints = {
        name: JointImpedance(
            stiffness=case.stiffness,
            damping=case.damping,
            equilibrium_angle=angle,
            friction_compensation_gain=case.gain,
        )
        for name, angle in zip(base.table.joints, POSTURE, strict=True)
    }
    phase = PhaseParameters(joints=joints, gravity_compensation=1.0)
    table = GaitTable(name=_HOLD, joints=base.table.joints, phases={_HOLD: phase}, transitions=())
    hip, knee = POSTURE
    scenario = BenchLegScenario(start_angles=(hip + TRUE_START, knee + TRUE_START))
    # A motion that grows is what is looked for here: no monitor may end it.
    control = replace(base.control, safety=replace(base.control.safety, enabled=False))
    return replace(base, name=_HOLD, table=table, scenario=scenario, control=control, duration=DURATION)


def linear_experiment(case: Case, velocity: float) -> Experiment:
    """The same leg with friction and its model replaced by their slopes at a velocity.

    Args:
        case: k, b and G.
        velocity: In [rad] / [s].

    Returns:
        The experiment.
    """
    true = true_experiment(case)
    plant, control = true.plant, true.control
    hip, knee = POSTURE
    return replace(
        true,
        scenario=BenchLegScenario(start_angles=(hip + LINEAR_START, knee + LINEAR_START)),
        plant=replace(
            plant,
            friction={joint: _viscous(law, velocity) for joint, law in plant.true_friction().items()},
            friction_ratio=dict.fromkeys(plant.friction, 1.0),
        ),
        control=replace(
            control,
            friction_model={joint: _viscous(law, velocity) for joint, law in control.friction_model.items()},
        ),
    )


def _viscous(law: FrictionParameters, velocity: float) -> FrictionParameters:
    slope = friction_slope(law, velocity)
    return FrictionParameters(
        breakaway_torque=0.0, coulomb_friction=0.0, breakaway_velocity=1.0, viscous_friction=slope
    )


# ---------------------------------------------------------------------- one case


@cache
def _any_loop(velocity: float) -> LinearLoop:
    """Loop of the bench leg at the posture; k, b and G are put in by the case."""
    experiment = true_experiment(Case(STIFFNESSES[0], DAMPINGS[0], GAINS[0]))
    (leg,) = hanging_legs(Subject(table=experiment.table, experiment=experiment, limits={}))
    return leg.linear_loop(0, velocity)


def predicted_radius(case: Case, velocity: float) -> float:
    """Spectral radius of the closed-loop transition matrix of a case.

    Args:
        case: k, b and G.
        velocity: Where friction is linearised in [rad] / [s].

    Returns:
        The radius.
    """
    both = np.ones(len(POSTURE))
    loop = replace(
        _any_loop(velocity),
        stiffness=case.stiffness * both,
        damping=case.damping * both,
        gain=case.gain * both,
    )
    return spectral_radius(transition_matrix(loop))


def _motion(run: Run) -> np.ndarray:
    """Angles of hip and knee about the posture in [rad], shape ``(n_ticks, 2)``."""
    columns = [f"{Side.RIGHT}_{joint}_angle_rad" for joint in (JointName.HIP, JointName.KNEE)]
    return np.asarray(run.log[columns].to_numpy() - np.array(POSTURE))


def _within(run: Run, span: tuple[float, float]) -> np.ndarray:
    return ((run.log["time_s"] >= span[0]) & (run.log["time_s"] < span[1])).to_numpy()


def linear_run_grows(case: Case, velocity: float) -> bool:
    """Whether a small motion of the linear loop grows in the engine.

    Args:
        case: k, b and G.
        velocity: Where friction is linearised in [rad] / [s].

    Returns:
        True if it becomes large, or is larger at the end than early on.
    """
    run = simulate(linear_experiment(case, velocity))
    size = np.abs(_motion(run)).max(axis=1)
    if run.status is RunStatus.DIVERGED or size.max() > _LARGE:
        return True
    early, late = (float(size[_within(run, span)].max()) for span in (_EARLY, _LATE))
    return late > max(early, _ROUNDING)


def true_ending(case: Case) -> tuple[Ending, float]:
    """What becomes of a leg with friction, limits and stops.

    Args:
        case: k, b and G.

    Returns:
        Rest (still, creeping or dying out), a limit cycle inside the stops or a runaway into them; and half
        the range of the joint that moves most at the end in [rad].
    """
    run = simulate(true_experiment(case))
    if run.status is RunStatus.DIVERGED:
        return Ending.RUNAWAY, math.inf
    before, end = (_motion(run)[_within(run, span)] for span in (_BEFORE, _END))
    stops = [f"{Side.RIGHT}_{name}_stop_torque_Nm" for name in (JointName.HIP, JointName.KNEE)]
    return classify(before, end, at_stop=bool(run.log.loc[_within(run, _END), stops].to_numpy().any()))


def classify(before: np.ndarray, end: np.ndarray, *, at_stop: bool) -> tuple[Ending, float]:
    """What a motion comes to, from two spans of equal length at its end.

    Args:
        before: Angles in the span before the last in [rad], shape ``(n_ticks, n_joints)``.
        end: Angles in the last span.
        at_stop: Whether a stop was touched.

    Returns:
        Rest (still, creeping or dying out), a limit cycle inside the stops or a runaway into them; and half
        the range of the joint that moves most in the last span in [rad].
    """
    joint = int(np.argmax(np.ptp(end, axis=0)))
    amplitude, earlier = 0.5 * float(np.ptp(end[:, joint])), 0.5 * float(np.ptp(before[:, joint]))
    if at_stop:
        return Ending.RUNAWAY, amplitude
    steps = np.diff(end[:, joint])
    creeps = bool((steps >= 0.0).all() or (steps <= 0.0).all())
    rests = amplitude < _STILL or creeps or amplitude < _DIES * earlier
    return (Ending.REST if rests else Ending.LIMIT_CYCLE), amplitude


def witness(case: Case) -> LoopResult:
    """Predict one case and run it.

    Args:
        case: k, b and G.

    Returns:
        Prediction and what was seen.
    """
    radii = tuple(predicted_radius(case, velocity) for velocity in VELOCITIES)
    grows = tuple(linear_run_grows(case, velocity) for velocity in VELOCITIES)
    return LoopResult(case, radii, grows, *true_ending(case))


def witness_all(
    cases: Iterable[Case], progress: Callable[[int, int], None] | None = None
) -> list[LoopResult]:
    """Predict and run many cases.

    Args:
        cases: The cases.
        progress: Called with cases done and in all.

    Returns:
        One result per case, in order.
    """
    cases = list(cases)
    results = []
    for case in cases:
        results.append(witness(case))
        if progress is not None:
            progress(len(results), len(cases))
    return results
