"""Settings that can change during a run, as one frozen value, and the numbers that they give the loop."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from typing import Any

from twin_gait.core.control_tick import COLUMNS_PER_JOINT
from twin_gait.experiment.events import HELD_PHASE
from twin_gait.experiment.experiment import Experiment
from twin_gait.gait.table import GaitTable, JointImpedance, PhaseParameters, Scaling
from twin_gait.network.messages import CODES
from twin_gait.simulation.simulation_setup import SimulationSetup, build_setup
from twin_gait.vocabulary import Side

# Source of the setpoints: the gait table, or one of the three controls of the thesis's monitor (2.4).
MODES = WALK, FRICTION, TORQUE, IMPEDANCE = CODES["control"]


@dataclass(frozen=True, kw_only=True)
class Settings:
    """Settings that events and the controls of a live session change.

    Simulation setups that depend on the settings are computed when they are first read, and cached.
    """

    experiment: Experiment  # Experiment with the present gait table, belt speed and support.
    monitor: Mapping[Side, PhaseParameters]  # Impedances that the monitor sets, as one phase of each leg.
    torques: Mapping[str, float]  # Target torques that the monitor sets in [N·m], by joint (``left_hip``).
    mode: str = WALK  # Source of the setpoints, one of ``MODES``.
    manual: bool = False  # Whether every step waits for a command of the operator.
    # Values of the live controls that have been set, by name, in their units.
    changes: Mapping[str, Any] = field(default_factory=dict)

    __hash__ = object.__hash__  # by identity, for caches; a mapping has no hash

    @property
    def table(self) -> GaitTable:
        """Gait table before scaling."""
        return self.experiment.table

    @cached_property
    def setup(self) -> SimulationSetup:
        """Simulation setup of the experiment."""
        return build_setup(self.experiment)

    @cached_property
    def active_setup(self) -> SimulationSetup:
        """Simulation setup of :attr:`active_experiment`."""
        return (
            self.setup if self.active_experiment is self.experiment else build_setup(self.active_experiment)
        )

    @cached_property
    def active_experiment(self) -> Experiment:
        """Experiment with the impedances of the mode.

        The impedances of the monitor are those of all phases; friction and torque control have no spring and
        no damper.
        """
        if self.mode == WALK:
            return self.experiment
        without = {} if self.mode == IMPEDANCE else {"stiffness": 0.0, "damping": 0.0}
        everywhere = {}
        for side, phase in self.monitor.items():
            joints = {name: replace(joint, **without) for name, joint in phase.joints.items()}
            everywhere[side] = dict.fromkeys(self.table.phases, PhaseParameters(joints=joints))
        table = replace(self.table, side_phases=everywhere, scaling=Scaling())
        return replace(self.experiment, table=table)


def first_settings(experiment: Experiment) -> Settings:
    """Return the settings at the start of a session, which are those of the experiment.

    The impedances of the monitor are those of the first phase of the table, so that a standing wearer remains
    standing in impedance control.
    """
    problem, monitor = build_setup(experiment), {}
    for side, rows in zip(problem.sides, problem.phase_rows, strict=True):
        first, joints = rows[0, :-1].reshape(-1, COLUMNS_PER_JOINT).tolist(), {}
        for name, (k, b, zero, gain) in zip(problem.table.joints, first, strict=True):
            joints[name] = JointImpedance(
                stiffness=k, damping=b, equilibrium_angle=zero, friction_compensation_gain=gain
            )
        monitor[side] = PhaseParameters(joints=joints)
    torques = zip(problem.joints, numbers_of(problem)["target_torque"], strict=True)
    named = {f"{item.side}_{item.joint}": torque for item, torque in torques}
    return Settings(experiment=experiment, monitor=monitor, torques=named)


LoopNumbers = Mapping[str, Any]


def numbers_of(setup: SimulationSetup) -> dict[str, Any]:
    """Return the changeable numbers of a loop in SI units, with scaled table and resolved damping ratios."""
    world, pelvis = setup.world, setup.world.model.pelvis_index
    torques = setup.experiment.control.target_torque
    return {
        # Values of k, b, θ0, G per joint and the gravity share, by leg and phase.
        "phase_rows": setup.phase_rows.tolist(),
        "comparisons": [asdict(comparison) for comparison in setup.program.comparisons],
        "target_torque": [torques.get(item.joint, 0.0) for item in setup.joints],
        "belt_speed": float(world.belt.cruise),
        # None without a pelvis in a body-weight support.
        "support_force": None if pelvis is None else world.support(pelvis).force,
        "held_phase": None,  # phase that a leg leaves only when it is released
        "watching": True,  # whether the safety monitor checks the timeout of a phase
    }


def loop_numbers(settings: Settings) -> LoopNumbers:
    """Return the numbers of a loop for settings."""
    numbers = numbers_of(settings.setup)
    if settings.mode != WALK:
        controls_torque = settings.mode == TORQUE
        numbers |= {
            "phase_rows": settings.active_setup.phase_rows.tolist(),
            "target_torque": [torque if controls_torque else 0.0 for torque in settings.torques.values()],
            "belt_speed": 0.0,  # without a gait the belt would carry the feet away
            "watching": False,
        }
    if settings.manual:
        numbers["held_phase"] = settings.table.phase_index(HELD_PHASE)
    return numbers


def value_at_path(record: Any, path: str) -> Any:
    """Return a nested value of a record; ``path``: fields and keys with dots between them."""
    for step in path.split("."):
        record = record[step] if isinstance(record, (dict, Mapping)) else getattr(record, step)
    return record


# Pairs of keys of which only one is set.
_EITHER = {"damping": "damping_ratio", "damping_ratio": "damping"}


def replace_at_path(record: Any, path: str, value: Any) -> Any:
    """Return a copy of a record with another value at a path of fields and keys with dots between them.

    Damping and damping ratio replace each other.
    """
    step, _, rest = path.partition(".")
    inner = replace_at_path(value_at_path(record, step), rest, value) if rest else value
    if isinstance(record, Mapping):
        return {**record, step: inner}
    return replace(record, **{step: inner}, **({_EITHER[step]: None} if step in _EITHER else {}))


def apply_changes(settings: Settings, changes: Mapping[str, Any]) -> Settings:
    """Return settings with new values at some paths.

    A phase that one side of the table does not define yet is first copied from the phase of both sides.
    """
    for path, value in changes.items():
        _, *steps = path.split(".")
        if steps[:2] == ["table", "side_phases"]:
            side, phase = steps[2:4]
            phases = {phase: settings.table.phases[phase], **settings.table.side_phases.get(Side(side), {})}
            settings = replace_at_path(settings, f"experiment.table.side_phases.{side}", phases)
        settings = replace_at_path(settings, path, value)
    return settings
