"""Parameters of a policy: inputs, outputs and weights of its network, as a file states them."""

import math
import re
from dataclasses import dataclass
from typing import Annotated

from twin_gait.core.control_tick import DAMPING, EQUILIBRIUM, GAIN, STIFFNESS
from twin_gait.gait.table import TICK
from twin_gait.parameters.quantities import (
    DEGREE,
    POSITIVE,
    Notation,
    Parameters,
    Range,
    Ratio,
    Time,
    integer_range,
    require,
)
from twin_gait.vocabulary import JointName

TORQUE = 4  # Column of a torque, after those of an impedance.
SHARES = Range(0.0, 1.0, exclusive_minimum=True, reason="a stiffness, damping or gain must not be negative")
# Quantities that an output changes: column of a setpoint, value in SI of one unit, and range of the bound. A
# share multiplies the value of the table, an angle and a torque are added.
QUANTITIES = {
    "stiffness_share": (STIFFNESS, 1.0, SHARES),
    "damping_share": (DAMPING, 1.0, SHARES),
    "friction_compensation_share": (GAIN, 1.0, SHARES),
    "equilibrium_deg": (EQUILIBRIUM, DEGREE, Range(0.0, 30.0, exclusive_minimum=True)),
    "torque_Nm": (TORQUE, 1.0, Range(0.0, 1e3, exclusive_minimum=True)),
}
PHASE, ERROR, LAST = "phase.", ".error_deg", "last."  # Parts of the names of inputs that are no signals.
PERIODS = Range(TICK, 1.0, words=f"a multiple of {TICK:g} s from {TICK:g} to 1 s")
UNITS = integer_range(1, 64, "a network that a microcontroller evaluates in a tick")
_FACTOR = re.compile(r"\s*(\S+)\s*([*/])\s*(\d+\.?\d*(?:[eE][-+]?\d+)?)\s*")


@dataclass(frozen=True)
class PolicyInput:
    """Input of a policy: a signal divided by a number that brings it to the order of 1."""

    signal: str  # Name of the signal.
    divisor: float  # Divisor in the unit of the signal.

    def __str__(self) -> str:
        return f"{self.signal} / {self.divisor!r}"


@dataclass(frozen=True)
class PolicyOutput:
    """Output of a policy: a quantity of a joint, and its largest change."""

    joint: JointName  # Joint of the leg.
    quantity: str  # One of :data:`QUANTITIES`.
    bound: float  # Largest change, in the unit of the quantity.

    def __str__(self) -> str:
        return f"{self.name} * {self.bound!r}"

    @property
    def name(self) -> str:
        """Name of the joint and the quantity."""
        return f"{self.joint}.{self.quantity}"


def _split(text: str, sign: str, example: str) -> tuple[str, float]:
    """Split a name from its factor or divisor."""
    found = _FACTOR.fullmatch(text)
    value = float(found[3]) if found and found[2] == sign else 0.0
    require(0.0 < value < math.inf, "input or output", f"text such as {example!r}", text)
    assert found is not None
    return found[1], value


def parse_input(text: str) -> PolicyInput:
    """Read an input such as ``hip.angle_deg / 30``; raise ParameterError if it cannot be read."""
    return PolicyInput(*_split(text, "/", "hip.angle_deg / 30"))


def parse_output(text: str) -> PolicyOutput:
    """Read an output such as ``hip.torque_Nm * 8``; raise ParameterError if it cannot be read."""
    name, bound = _split(text, "*", "hip.torque_Nm * 8")
    joint, _, quantity = name.partition(".")
    require(joint in list(JointName), "output", f"a joint, one of {', '.join(JointName)}", joint)
    require(quantity in QUANTITIES, "output", f"a quantity, one of {', '.join(QUANTITIES)}", quantity)
    QUANTITIES[quantity][2].require(f"bound of {name}", bound)
    return PolicyOutput(JointName(joint), quantity, bound)


@dataclass(frozen=True, kw_only=True)
class PolicyParameters(Parameters):
    """Network of the mode ``policy``, with one hidden layer.

    Attributes:
        name: Name in messages.
        description: Purpose in one line.
        inputs: Signals, each divided by a number. Signals are those of the guards of a gait table,
            ``phase.NAME`` (1 in this phase, otherwise 0), ``JOINT.error_deg`` (mean absolute difference from
            healthy walking in the last stride) and ``last.JOINT.QUANTITY`` (output of the last control step).
        outputs: Changed quantities of joints, each times its bound.
        hidden_units: Number of units of the hidden layer.
        weights: Weights of the hidden layer, then of the outputs: for each unit its bias, then the weight of
            each input.
        per_stride: Whether a leg computes new outputs only when it begins a stride.
        period: Control step in [s], a whole number of ticks.
        ramp: Time in [s] in which an output moves by its bound at most.
        training: Script, seed and software with which the weights were found.
    """

    name: str = "own"
    description: str = ""
    inputs: Annotated[tuple[PolicyInput, ...], Notation(parse_input)]
    outputs: Annotated[tuple[PolicyOutput, ...], Notation(parse_output)]
    hidden_units: Annotated[int, UNITS] = 8
    weights: tuple[Ratio, ...]
    per_stride: bool = False
    period: Annotated[Time, PERIODS] = 0.01
    ramp: Annotated[Time, POSITIVE] = 0.05
    training: str = ""

    def __post_init__(self) -> None:
        """Check ranges, sizes and names."""
        super().__post_init__()
        whole = self.period_ticks >= 1 and abs(self.period_ticks * TICK - self.period) < 1e-9
        require(whole, "period", PERIODS.expected, self.period)
        for key, names in {"inputs": self.input_names, "outputs": self.output_names}.items():
            require(0 < len(set(names)) == len(names), key, "one or more different names", ", ".join(names))
        size = f"{len(self.inputs)} inputs, {self.hidden_units} hidden units and {len(self.outputs)} outputs"
        count = self.hidden_count + (self.hidden_units + 1) * len(self.outputs)
        require(len(self.weights) == count, "weights", f"{count} numbers for {size}", len(self.weights))

    @property
    def period_ticks(self) -> int:
        """Control step in ticks."""
        return round(self.period / TICK)

    @property
    def hidden_count(self) -> int:
        """Number of weights of the hidden layer."""
        return (len(self.inputs) + 1) * self.hidden_units

    @property
    def input_names(self) -> tuple[str, ...]:
        """Names of the signals of the inputs."""
        return tuple(item.signal for item in self.inputs)

    @property
    def output_names(self) -> tuple[str, ...]:
        """Names of joint and quantity of the outputs."""
        return tuple(item.name for item in self.outputs)
