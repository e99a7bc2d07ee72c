"""Faults injected into a run, and their notation: ``encoder_freeze:left_knee@4.2s``."""

import math
import re
from collections.abc import Collection
from dataclasses import dataclass

from twin_gait.exceptions import ParameterError
from twin_gait.parameters.quantities import DEGREE, NOT_NEGATIVE, require
from twin_gait.vocabulary import Coded, JointName, Side

FOOT = "foot"
_SHAPE = re.compile(r"([a-z_]+)(?::([a-z_]+))?@([^=@\s]+?)s(?:=(\S+))?")
_MAGNITUDE = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d+)?)([A-Za-z/]*)")


class FaultKind(Coded):
    """What breaks; ``code`` is its number in :mod:`twin_gait.core.faults`."""

    ENCODER_FREEZE = "encoder_freeze"
    ENCODER_JUMP = "encoder_jump"
    ENCODER_MISSING = "encoder_missing"
    ENCODER_DRIFT = "encoder_drift"
    ENCODER_OFFSET = "encoder_offset"
    MOTOR_DEAD = "motor_dead"
    MOTOR_STUCK = "motor_stuck"
    CONTROLLER_RUNAWAY = "controller_runaway"
    FOOT_LOAD_STUCK = "foot_load_stuck"
    SUPPLY_DIP = "supply_dip"

    @property
    def units(self) -> dict[str, float]:
        """Units in which a magnitude may be given, with their factors to SI; SI first."""
        return _MAGNITUDES.get(self, (0.0, {}))[1]


# Magnitude in SI units where none is given, and the units that it may have; not of a kind without one.
_MAGNITUDES: dict[FaultKind, tuple[float, dict[str, float]]] = {
    FaultKind.ENCODER_JUMP: (10.0 * DEGREE, {"rad": 1.0, "deg": DEGREE}),
    FaultKind.ENCODER_OFFSET: (5.0 * DEGREE, {"rad": 1.0, "deg": DEGREE}),
    FaultKind.ENCODER_DRIFT: (20.0 * DEGREE, {"rad/s": 1.0, "deg/s": DEGREE}),
    FaultKind.MOTOR_STUCK: (30.0, {"Nm": 1.0}),
    FaultKind.CONTROLLER_RUNAWAY: (200.0, {"Nm/s": 1.0}),
    FaultKind.SUPPLY_DIP: (15.0, {"V": 1.0}),
}


@dataclass(frozen=True, kw_only=True)
class Fault:
    """One fault; it lasts to the end of the run but for a jump (5 ms) and a dip of the supply (0.5 s)."""

    kind: FaultKind  # What breaks.
    time: float  # When, in [s].
    side: Side | None = None  # Leg; None for the supply.
    joint: JointName | None = None  # Joint; None for a foot and the supply.
    # Angle in [rad], rate in [rad] / [s], torque in [N m], rate in [N m] / [s] or voltage in [V], as the kind
    # has it; None takes the kind's own.
    magnitude: float | None = None

    def __post_init__(self) -> None:
        """Check that kind, place and magnitude fit together."""
        NOT_NEGATIVE.require("time", self.time)
        kind, units = self.kind, self.kind.units
        has = (self.side is not None, self.joint is not None)
        wanted = (
            kind is not FaultKind.SUPPLY_DIP,
            kind not in (FaultKind.SUPPLY_DIP, FaultKind.FOOT_LOAD_STUCK),
        )
        require(has == wanted, f"place of {kind}", _expected_place(kind), self.place)
        if self.magnitude is not None:
            fits = bool(units) and math.isfinite(self.magnitude)
            expected = f"a number in {' or '.join(units)}" if units else "no magnitude"
            require(fits, f"magnitude of {kind}", expected, self.magnitude)

    @property
    def place(self) -> str:
        """Place as the notation has it: ``left_knee``, ``left_foot``, or nothing for the supply."""
        if self.side is None:
            return ""
        return f"{self.side}_{FOOT if self.joint is None else self.joint}"

    @property
    def strength(self) -> float:
        """Magnitude in SI units; 0 for a kind without one."""
        return _MAGNITUDES.get(self.kind, (0.0, {}))[0] if self.magnitude is None else self.magnitude

    def __str__(self) -> str:
        """The fault in its notation; reading it gives an equal fault."""
        place = f":{self.place}" if self.place else ""
        size = "" if self.magnitude is None else f"={self.magnitude!r}{next(iter(self.kind.units))}"
        return f"{self.kind}{place}@{self.time!r}s{size}"


def _expected_place(kind: FaultKind, joints: Collection[str] = tuple(JointName)) -> str:
    """Where faults of a kind can be injected, in words."""
    if kind is FaultKind.SUPPLY_DIP:
        return "no place, as in supply_dip@4.2s"
    names = [FOOT] if kind is FaultKind.FOOT_LOAD_STUCK else joints
    return " or ".join(f"left_{name} or right_{name}" for name in names)


def parse_fault(text: str) -> Fault:
    """Read a fault in its notation.

    ``KIND:SIDE_JOINT@TIMEs``, with ``=`` and a magnitude with its unit where the kind has one:
    ``encoder_freeze:left_knee@4.2s``, ``encoder_drift:right_hip@3s=20deg/s``,
    ``foot_load_stuck:left_foot@2s``, ``supply_dip@5s=12V``.

    Raises ParameterError if it cannot be read.
    """
    try:
        return _parsed(text.strip())
    except ParameterError as error:
        raise ParameterError(f"fault {text!r}: {error}") from error


def _parsed(text: str) -> Fault:
    match = _SHAPE.fullmatch(text)
    if match is None:
        raise ParameterError("expected KIND:SIDE_JOINT@TIMEs, for example encoder_freeze:left_knee@4.2s")
    name, place, time, size = match.groups()
    if name not in list(FaultKind):
        raise ParameterError(f"no kind {name!r}; there are {', '.join(FaultKind)}")
    kind, side, joint = FaultKind(name), None, None
    try:
        seconds = float(time)
    except ValueError:
        raise ParameterError(f"expected a time in seconds, got {time!r}") from None
    if place is not None:
        leg, _, part = place.partition("_")
        if leg not in list(Side) or part not in (FOOT, *JointName):
            raise ParameterError(f"no place {place!r}; expected {_expected_place(kind)}")
        side, joint = Side(leg), None if part == FOOT else JointName(part)
    return Fault(kind=kind, time=seconds, side=side, joint=joint, magnitude=_magnitude(kind, size))


def _magnitude(kind: FaultKind, size: str | None) -> float | None:
    if size is None:
        return None
    match = _MAGNITUDE.fullmatch(size)
    if not kind.units:
        raise ParameterError(f"{kind} has no magnitude; leave out ={size}")
    if match is None or match.group(2) not in kind.units:
        raise ParameterError(f"expected a magnitude in {' or '.join(kind.units)}, got {size!r}")
    return float(match.group(1)) * kind.units[match.group(2)]


def check_faults(
    faults: Collection[Fault],
    sides: Collection[Side],
    feet: bool,
    duration: float,
    joints: Collection[JointName],
) -> None:
    """Check that faults act on something that is there, within the run.

    ``duration``: of the run in [s]. ``joints``: those that are controlled.
    """
    for fault in faults:
        if fault.side is not None and fault.side not in sides:
            raise ParameterError(f"fault {fault}: there is no {fault.side} leg, only {', '.join(sides)}")
        if fault.joint is not None and fault.joint not in joints:
            expected = _expected_place(fault.kind, joints)
            raise ParameterError(f"fault {fault}: no {fault.joint} is controlled; expected {expected}")
        if fault.kind is FaultKind.FOOT_LOAD_STUCK and not feet:
            raise ParameterError(f"fault {fault}: the feet of this experiment have no load sensors")
        if fault.time >= duration:
            raise ParameterError(f"fault {fault}: the run ends at {duration:g} s; choose an earlier time")
