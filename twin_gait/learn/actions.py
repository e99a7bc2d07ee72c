"""Actions of an environment for learning: vectors with values from -1 to 1 that are written into the records.

An action acts in the gait controller, so that bus, boards, limits and safety monitor act on it as on any
setpoint.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from twin_gait.control.controllers.policy import Policy
from twin_gait.core.control_tick import COLUMNS_PER_JOINT, DAMPING, EQUILIBRIUM, GAIN, STIFFNESS
from twin_gait.exceptions import ParameterError
from twin_gait.learn.signals import RecordMap, Signals, word_of, words_of
from twin_gait.parameters.quantities import POSITIVE, SHARE, require
from twin_gait.simulation.simulation_setup import SimulationSetup

# Column of a setpoint and value in SI of one unit, by the name of the quantity in a gait table.
_COLUMNS = {
    "stiffness_Nm_per_rad": (STIFFNESS, 1.0),
    "stiffness_Nm_per_deg": (STIFFNESS, 180.0 / np.pi),
    "damping_Nms_per_rad": (DAMPING, 1.0),
    "equilibrium_rad": (EQUILIBRIUM, 1.0),
    "equilibrium_deg": (EQUILIBRIUM, np.pi / 180.0),
    "friction_compensation_gain": (GAIN, 1.0),
}


class BoundAction(ABC):
    """Action of the records of one pattern.

    Attributes:
        names: Meaning of each number of the action.
    """

    names: tuple[str, ...]

    @abstractmethod
    def reset(self, numbers: np.ndarray, lane: int) -> None:
        """Store the values of a new episode; ``numbers``: all records, shape ``(n_words, n)``."""

    @abstractmethod
    def apply(self, signals: Signals, numbers: np.ndarray, action: np.ndarray) -> None:
        """Write an action, shape ``(n, len(names))`` with values from -1 to 1, into the records."""


class Action(ABC):
    """Base class of the actions, each a frozen record of its ranges."""

    @abstractmethod
    def bind(self, setup: SimulationSetup, places: RecordMap, count: int) -> BoundAction:
        """Return the action of ``count`` records; raises ParameterError for ranges that do not fit."""


@dataclass(frozen=True)
class TorqueAction(Action):
    """Torques on top of the controller, one for each driven joint.

    Attributes:
        share: Largest torque as a share of the torque limit of the joint.
    """

    share: float = 0.2

    def bind(self, setup: SimulationSetup, places: RecordMap, count: int) -> BoundAction:
        """Return the action of ``count`` records."""
        SHARE.require("TorqueAction.share", self.share)
        limits = setup.experiment.control.limits
        names = tuple(f"{item.side}_{item.joint}_torque" for item in setup.joints)
        return _Torques(
            names,
            [word_of(places.root.controller.joints[index].target) for index in range(len(names))],
            np.array([self.share * limits[item.joint].torque for item in setup.joints]),
            np.zeros((len(names), count)),
        )


@dataclass
class _Torques(BoundAction):
    names: tuple[str, ...]
    words: list[int]
    largest: np.ndarray
    base: np.ndarray

    def reset(self, numbers: np.ndarray, lane: int) -> None:
        self.base[:, lane] = numbers[self.words, lane]

    def apply(self, signals: Signals, numbers: np.ndarray, action: np.ndarray) -> None:
        numbers[self.words] = self.base + self.largest[:, None] * action.T


@dataclass(frozen=True)
class ImpedanceAction(Action):
    """Stiffness, damping, equilibrium angle and friction compensation gain of each driven joint.

    They replace the values of the gait table in all phases. -1 is the lowest and 1 the highest value that the
    table has for the joint in any phase, unless ``ranges`` states other values.

    Attributes:
        ranges: Lowest and highest value by quantity, such as ``{"equilibrium_deg": (-20, 60)}``.
        quantities: Quantities that the action sets; the others keep the values of the table.
    """

    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    quantities: tuple[str, ...] = (
        "stiffness_Nm_per_rad", "damping_Nms_per_rad", "equilibrium_rad", "friction_compensation_gain",
    )  # fmt: skip

    def bind(self, setup: SimulationSetup, places: RecordMap, count: int) -> BoundAction:
        """Return the action of ``count`` records."""
        given = {_column(f"ImpedanceAction.ranges.{name}", name)[0]: name for name in self.ranges}
        columns = [_column("ImpedanceAction.quantities", name)[0] for name in self.quantities]
        names, words, low, high = list[str](), list[np.ndarray](), list[float](), list[float]()
        rows = setup.phase_rows[..., :-1].reshape(*setup.phase_rows.shape[:2], -1, COLUMNS_PER_JOINT)
        per_leg = rows.shape[2]
        for index, item in enumerate(setup.joints):
            table = rows[index // per_leg, :, index % per_leg]
            for name, column in zip(self.quantities, columns, strict=True):
                span = float(table[:, column].min()), float(table[:, column].max())
                if column in given:
                    factor = _COLUMNS[given[column]][1]
                    first, last = self.ranges[given[column]]
                    span = factor * first, factor * last
                require(span[0] <= span[1], f"ImpedanceAction.ranges.{name}", "lowest before highest", span)
                names.append(f"{item.side}_{item.joint}_{name}")
                words.append(_words_of(places, index, column))
                low.append(span[0])
                high.append(span[1])
        return _Impedances(tuple(names), words, np.array(low), np.array(high))


@dataclass
class _Impedances(BoundAction):
    names: tuple[str, ...]
    words: list[np.ndarray]
    low: np.ndarray
    high: np.ndarray

    def reset(self, numbers: np.ndarray, lane: int) -> None:
        """Nothing to store."""

    def apply(self, signals: Signals, numbers: np.ndarray, action: np.ndarray) -> None:
        values = self.low[:, None] + 0.5 * (action.T + 1.0) * (self.high - self.low)[:, None]
        for words, value in zip(self.words, values, strict=True):
            numbers[words] = value


@dataclass(frozen=True)
class PositionAction(Action):
    """Set points of position: equilibrium angles of a spring and damper that are the same in all phases.

    Attributes:
        stiffness: Stiffness of the spring in [N·m/rad].
        damping: Damping in [N·m·s/rad].
        angles_deg: Lowest and highest set point in [deg], by joint; those of the gait table by default.
    """

    stiffness: float = 200.0
    damping: float = 10.0
    angles_deg: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    def bind(self, setup: SimulationSetup, places: RecordMap, count: int) -> BoundAction:
        """Return the action of ``count`` records."""
        POSITIVE.require("PositionAction.stiffness", self.stiffness)
        POSITIVE.require("PositionAction.damping", self.damping)
        angles = ImpedanceAction(quantities=("equilibrium_rad",)).bind(setup, places, count)
        assert isinstance(angles, _Impedances)
        known = {str(item.joint) for item in setup.joints}
        for name, (first, last) in self.angles_deg.items():
            require(name in known, "PositionAction.angles_deg", f"one of {', '.join(sorted(known))}", name)
            require(
                first <= last, f"PositionAction.angles_deg.{name}", "lowest before highest", (first, last)
            )
            chosen = [str(item.joint) == name for item in setup.joints]
            angles.low[chosen], angles.high[chosen] = np.radians(first), np.radians(last)
        constants = {STIFFNESS: self.stiffness, DAMPING: self.damping}
        springs = [
            (_words_of(places, index, column), value)
            for index in range(len(setup.joints))
            for column, value in constants.items()
        ]
        return _Positions(angles.names, angles.words, angles.low, angles.high, springs)


@dataclass
class _Positions(_Impedances):
    springs: list[tuple[np.ndarray, float]]

    def apply(self, signals: Signals, numbers: np.ndarray, action: np.ndarray) -> None:
        super().apply(signals, numbers, action)
        for words, value in self.springs:
            numbers[words] = value


@dataclass(frozen=True)
class TableAction(Action):
    """Changes of parameters of the gait table, for both legs.

    A changed phase acts when a leg enters it next: the parameters of a phase do not change while a leg is in
    it.

    Attributes:
        changes: Largest change by parameter, such as ``{"late_stance.knee.equilibrium_deg": 5}``.
        per_stride: Whether a leg takes a new action only when it enters the first phase of the table;
            otherwise in every control step.
    """

    changes: Mapping[str, float]
    per_stride: bool = True

    def bind(self, setup: SimulationSetup, places: RecordMap, count: int) -> BoundAction:
        """Return the action of ``count`` records."""
        require(len(self.changes) > 0, "TableAction.changes", "at least one parameter", "none")
        phases, joints = list(setup.table.phase_names), [str(item) for item in setup.table.joints]
        found = list[tuple[int, int, int]]()
        for key in self.changes:
            phase, _, rest = key.partition(".")
            joint, _, name = rest.partition(".")
            where = f"TableAction.changes.{key}"
            require(phase in phases, where, f"a phase, one of {', '.join(phases)}", phase)
            require(joint in joints, where, f"a joint, one of {', '.join(joints)}", joint)
            found.append((phases.index(phase), joints.index(joint), _column(where, name)[0]))
        factors = [_COLUMNS[key.rpartition(".")[2]][1] for key in self.changes]
        words = [
            [
                int(
                    words_of(places.root.controller.joints[leg * len(joints) + joint].setpoints[phase])[
                        column
                    ]
                )
                for phase, joint, column in found
            ]
            for leg in range(len(setup.sides))
        ]
        largest = np.array(factors) * np.array(list(self.changes.values()))
        return _TableChanges(
            tuple(self.changes),
            [f"{side}_" for side in setup.sides],
            [phase for phase, _, _ in found],
            words,
            largest,
            self.per_stride,
            np.zeros((*np.shape(words), count)),
            np.zeros((*np.shape(words), count)),
        )


@dataclass
class _TableChanges(BoundAction):
    names: tuple[str, ...]
    prefixes: list[str]
    phases: list[int]  # Phase of each parameter.
    words: list[list[int]]  # Word by leg and parameter.
    largest: np.ndarray
    per_stride: bool
    base: np.ndarray  # Values of the table by leg, parameter and record.
    taken: np.ndarray  # Actions that the legs have taken, in the same shape.

    def reset(self, numbers: np.ndarray, lane: int) -> None:
        for leg, words in enumerate(self.words):
            self.base[leg, :, lane] = numbers[words, lane]
        self.taken[:, :, lane] = 0.0

    def apply(self, signals: Signals, numbers: np.ndarray, action: np.ndarray) -> None:
        for leg, prefix in enumerate(self.prefixes):
            phase = signals[f"{prefix}phase"]
            since = signals.tick - signals[f"{prefix}phase_entry_tick"]
            takes = (
                (phase == 0.0) & (since <= signals.ticks) if self.per_stride else np.full(len(phase), True)
            )
            self.taken[leg] = np.where(takes, action.T, self.taken[leg])
            values = self.base[leg] + self.largest[:, None] * self.taken[leg]
            for word, own_phase, value in zip(self.words[leg], self.phases, values, strict=True):
                numbers[word] = np.where(phase == own_phase, numbers[word], value)


@dataclass(frozen=True)
class PolicyAction(Action):
    """Outputs of the policy of the experiment, in place of those of its network.

    With the outputs of the network, which :func:`twin_gait.learn.policy.policy_outputs` computes from the
    inputs (the signals ``policy_input``), an episode is that of ``control.mode: policy``, bit for bit.
    """

    def bind(self, setup: SimulationSetup, places: RecordMap, count: int) -> BoundAction:
        """Return the action of ``count`` records."""
        controller = setup.controller
        if not isinstance(controller, Policy):
            raise ParameterError("PolicyAction: expected an experiment with control.mode policy")
        outputs = controller.network.output_names
        names = tuple(f"{side}_{name}" for side in setup.sides for name in outputs)
        return _PolicyOutputs(names, words_of(places.root.controller.memory.outputs)[:, 0])


@dataclass
class _PolicyOutputs(BoundAction):
    names: tuple[str, ...]
    words: np.ndarray

    def reset(self, numbers: np.ndarray, lane: int) -> None:
        """Nothing to store."""

    def apply(self, signals: Signals, numbers: np.ndarray, action: np.ndarray) -> None:
        numbers[self.words] = action.T


def _column(where: str, name: str) -> tuple[int, float]:
    """Return column and factor of a quantity; raises ParameterError for an unknown one."""
    if name not in _COLUMNS:
        raise ParameterError(f"{where}: expected a quantity, one of {', '.join(_COLUMNS)}, got {name!r}")
    return _COLUMNS[name]


def _words_of(places: RecordMap, joint: int, column: int) -> np.ndarray:
    """Return the words of a setpoint's column: in all phases, and in the blended setpoints."""
    found = places.root.controller.joints[joint]
    single = [words_of(found.blend_start)[column], words_of(found.blended)[column]]
    return np.array([*words_of(found.setpoints)[:, column], *single])
