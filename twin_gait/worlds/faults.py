"""Faults injected into a run, and their notation: ``encoder_freeze:left_knee@4.2s``."""

import math
import re
from collections.abc import Collection, Iterable
from dataclasses import dataclass

from twin_gait.exceptions import ParameterError
from twin_gait.parameters.quantities import DEGREE, NOT_NEGATIVE, require
from twin_gait.vocabulary import CodedEnum, JointName, Side

FOOT = "foot"
_NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d+)?"
_SHAPE = re.compile(rf"([a-z_]+)(?::([a-z]+_[a-z]+))?@({_NUMBER})s(?:=({_NUMBER})([A-Za-z/]*))?")


class FaultKind(CodedEnum):
    """Kind of a fault; ``code`` is its number in :mod:`twin_gait.core.faults`."""

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
    SUPPLY_LOSS_SHORTED = "supply_loss_shorted"
    SUPPLY_LOSS_OPEN = "supply_loss_open"

    @property
    def units(self) -> dict[str, float]:
        """Units in which a magnitude may be given, with their factors to SI; the SI unit is the first."""
        return _MAGNITUDES.get(self, _NO_MAGNITUDE)[2]

    def location(self, side: Side, joint: JointName) -> str:
        """Return the affected part in the notation: a joint of a leg, its foot, or nothing for the supply."""
        if self in SUPPLY_FAULTS:
            return ""
        return f"{side}_{FOOT if self is FaultKind.FOOT_LOAD_STUCK else joint}"


LOSSES_OF_SUPPLY = FaultKind.SUPPLY_LOSS_SHORTED, FaultKind.SUPPLY_LOSS_OPEN
SUPPLY_FAULTS = FaultKind.SUPPLY_DIP, *LOSSES_OF_SUPPLY  # faults without a joint or a foot

# Default and largest magnitude in SI units, and the units in which one may be given; a kind that is missing
# has no magnitude. The largest are chosen like the ranges in :mod:`twin_gait.parameters.quantities`: half a
# turn, ten times the no-load speed, ten times the permissible torque of the gear, this torque within 10 ms,
# extra-low voltage, a hundred times the inductive time of the motors.
_MAGNITUDES: dict[FaultKind, tuple[float, float, dict[str, float]]] = {
    FaultKind.ENCODER_JUMP: (10.0 * DEGREE, math.pi, {"rad": 1.0, "deg": DEGREE}),
    FaultKind.ENCODER_OFFSET: (5.0 * DEGREE, math.pi, {"rad": 1.0, "deg": DEGREE}),
    FaultKind.ENCODER_DRIFT: (20.0 * DEGREE, 50.0, {"rad/s": 1.0, "deg/s": DEGREE}),
    FaultKind.MOTOR_STUCK: (30.0, 1e3, {"Nm": 1.0}),
    FaultKind.CONTROLLER_RUNAWAY: (200.0, 1e5, {"Nm/s": 1.0}),
    FaultKind.SUPPLY_DIP: (15.0, 120.0, {"V": 1.0}),
    FaultKind.SUPPLY_LOSS_SHORTED: (0.0, 100.0, {"s": 1.0}),
}
_NO_MAGNITUDE = 0.0, math.inf, dict[str, float]()


@dataclass(frozen=True, kw_only=True)
class Fault:
    """One fault; it lasts to the end of the run, except for a jump (5 ms) and a dip of the supply (0.5 s)."""

    kind: FaultKind  # Kind of the fault.
    time: float  # Time at which it begins, in [s].
    # Affected part in the notation: ``left_knee``, ``left_foot``, or nothing for the supply.
    location: str = ""
    # Angle in [rad], rate in [rad/s], torque in [N·m], rate in [N·m/s], voltage in [V] or inductive
    # time in [s], according to the kind; None means the default of the kind.
    magnitude: float | None = None

    def __post_init__(self) -> None:
        """Check that kind, place and magnitude fit together."""
        NOT_NEGATIVE.require("time", self.time)
        self._require_location("place", Side, JointName)
        _, most, units = _MAGNITUDES.get(self.kind, _NO_MAGNITUDE)
        if self.magnitude is not None:
            fits, expected = bool(units) and abs(self.magnitude) <= most, "no magnitude"
            if units:
                limit = f"{most:g} {next(iter(units))} at most, with either sign"
                expected = f"a number in {' or '.join(units)}, {limit}"
            require(fits, f"magnitude of {self.kind}", expected, self.magnitude)

    @property
    def side(self) -> Side | None:
        """Side of the affected leg; None for the supply."""
        return Side(self.location.partition("_")[0]) if self.location else None

    @property
    def joint(self) -> JointName | None:
        """Affected joint; None for a foot and the supply."""
        part = self.location.partition("_")[2]
        return JointName(part) if part in list(JointName) else None

    @property
    def magnitude_or_default(self) -> float:
        """Magnitude in SI units; 0 for a kind without one."""
        usual, *_ = _MAGNITUDES.get(self.kind, _NO_MAGNITUDE)
        return usual if self.magnitude is None else self.magnitude

    def require_fit(
        self, sides: Collection[Side], joints: Collection[JointName], feet: bool, duration: float
    ) -> None:
        """Check that a fault concerns a part that exists, and begins before the end of the run.

        ``joints``: joints that are controlled. ``feet``: whether the feet have load sensors. ``duration``:
        duration of the run in [s]. Raises ParameterError otherwise.
        """
        self._require_location(f"fault {self}", sides, joints)
        sensed = feet or self.kind is not FaultKind.FOOT_LOAD_STUCK
        require(sensed, "fault", "feet with load sensors", str(self))
        require(
            self.time < duration, "fault", f"a time before the end of the run at {duration:g} s", str(self)
        )

    def _require_location(self, name: str, sides: Iterable[Side], joints: Iterable[JointName]) -> None:
        locations = dict.fromkeys(self.kind.location(side, joint) for joint in joints for side in sides)
        words = " or ".join(locations) or f"no location, as in {self.kind}@4.2s"
        require(self.location in locations, name, words, self.location)

    def __str__(self) -> str:
        """Return the fault in its notation; parsing it gives an equal fault."""
        return insert_time(self.untimed_notation, self.time)

    @property
    def untimed_notation(self) -> str:
        """Notation of the fault without the time, as in the text of an event."""
        location = f":{self.location}" if self.location else ""
        size = "" if self.magnitude is None else f"={self.magnitude!r}{next(iter(self.kind.units))}"
        return f"{self.kind}{location}{size}"


def insert_time(text: str, time: float) -> str:
    """Insert a time in [s] into the notation of a fault without a time."""
    name, equals, size = text.partition("=")
    return f"{name}@{time!r}s{equals}{size}"


def parse_fault(text: str) -> Fault:
    """Parse the notation of a fault.

    The notation is ``KIND:SIDE_JOINT@TIMEs``, with ``=`` and a magnitude with its unit where the kind has
    one: ``encoder_freeze:left_knee@4.2s``, ``encoder_drift:right_hip@3s=20deg/s``,
    ``foot_load_stuck:left_foot@2s``, ``supply_dip@5s=12V``, ``supply_loss_shorted@5s``.

    Raises ParameterError if it cannot be read.
    """
    match = _SHAPE.fullmatch(text.strip())
    if match is None:
        shape = "KIND:SIDE_JOINT@TIMEs, for example encoder_freeze:left_knee@4.2s"
        raise ParameterError(f"fault {text!r}: expected {shape}")
    try:
        name, location, time, size, unit = match.groups()
        require(name in list(FaultKind), "kind", ", ".join(FaultKind), name)
        kind = FaultKind(name)
        require(unit is None or unit in kind.units, "unit", " or ".join(kind.units) or "no magnitude", unit)
        magnitude = None if size is None else float(size) * kind.units[unit]
        return Fault(kind=kind, time=float(time), location=location or "", magnitude=magnitude)
    except ParameterError as error:
        raise ParameterError(f"fault {text!r}: {error}") from error
