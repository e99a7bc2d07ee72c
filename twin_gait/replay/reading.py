"""From the columns of a log file to a recording: which column is what, in which unit and sign."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from itertools import product
from pathlib import Path

import numpy as np

from twin_gait.control import SafetyState
from twin_gait.conventions import CONVENTIONS, DEGREES, HOUSE, RADIANS, Convention
from twin_gait.exceptions import ParameterError, ParameterFileError
from twin_gait.gait.signals import DEVICE_SIGNALS
from twin_gait.parameters import require
from twin_gait.replay.recording import Recording, at_ticks
from twin_gait.runs.log_files import LogTable, read_table
from twin_gait.vocabulary import JointName, Side

TIME = "time"
_TIME_COLUMNS = ("time_s", "time", "Time", "t")
_UNIT_ENDINGS = {"_rad": RADIANS, "_deg": DEGREES, "[rad]": RADIANS, "[deg]": DEGREES, "(deg)": DEGREES}
_OF_DEVICE = {signal.field: signal for signal in DEVICE_SIGNALS if signal.column}  # signals by quantity

QUANTITIES = (
    TIME, *(f"{side}_{joint}_angle" for side in Side for joint in JointName),
    *(f"{side}_foot_normal_force" for side in Side), *(f"{side}_phase" for side in Side), *_OF_DEVICE,
)  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class LogFormat:
    """How to read a log."""

    # names and signs of the angles; None takes this package's own, and asks for one for files of OpenSim,
    # whose models differ
    convention: Convention | None = None
    # column of a quantity, where it has a name of its own: ``{"left_hip_angle": "hip_l"}``
    columns: Mapping[str, str] = field(default_factory=dict)
    units: str | None = None  # ``rad`` or ``deg``, for columns that do not say

    def __post_init__(self) -> None:
        """Check names and units."""
        for quantity in self.columns:
            if quantity not in QUANTITIES:
                raise ParameterError(f"columns: no quantity {quantity!r}; there are {', '.join(QUANTITIES)}")
        require(self.units in (None, RADIANS, DEGREES), "units", "rad or deg", self.units)


def read_recording(path: Path, log_format: LogFormat | None = None) -> Recording:
    """Read a recorded walk.

    ``path``: a .parquet or .csv file with columns such as ``left_hip_angle_rad``, or any with the names
    given; or a .mot or .sto file of OpenSim; ``log_format``: how to read it. Returns the walk at the ticks of
    the controller, in the signs of this package. Raises ParameterFileError if the file has a mistake; the
    message names file, column and the way out. Of a run whose legs were held, what comes before it.
    """
    table, log_format = read_table(path), log_format or LogFormat()
    if "safety_state" in table:  # from a trip on no guard moves the legs
        held = np.flatnonzero(table.numbers("safety_state") == SafetyState.HOLD.code)
        table = replace(table, frame=table.frame.iloc[: held[0]]) if len(held) else table
    if log_format.convention is None and table.opensim:
        text = (
            "OpenSim's models differ in the sign of the knee: add --convention opensim_gait2392 "
            "(flexion negative) or rajagopal (flexion positive)"
        )
        raise ParameterFileError(table.source, "convention", text)
    return _Reader(table, log_format, log_format.convention or HOUSE).recording()


@dataclass(frozen=True)
class _Reader:
    """A log file, and how to read it."""

    table: LogTable
    log_format: LogFormat
    convention: Convention

    def recording(self) -> Recording:
        """The walk."""
        table = self.table
        time = table.numbers(self._column(TIME, *_TIME_COLUMNS) or TIME)
        angles = self._angles()
        loads, phases, device = {}, {}, {}
        for side in angles:
            if load := self._column(f"{side}_foot_normal_force", f"{side}_foot_normal_force_N"):
                loads[side] = table.numbers(load)
            if phase := self._column(f"{side}_phase", f"{side}_phase"):
                phases[side] = table.words(phase)
        for key, signal in _OF_DEVICE.items():
            if column := self._column(key, signal.column):
                turns = signal.column.endswith("_rad")
                device[signal.name] = self._radians(column) if turns else table.numbers(column)
        return at_ticks(Recording(table.source, 0.0, angles, loads, phases, device), time)

    def _column(self, quantity: str, *usual: str) -> str | None:
        """The column that was named for a quantity, or else the first of its usual ones that there is."""
        asked = self.log_format.columns.get(quantity)
        return self.table.full_name(asked) if asked else next(filter(self.table.__contains__, usual), None)

    def _angles(self) -> dict[Side, dict[str, np.ndarray]]:
        convention, angles = self.convention, dict[Side, dict[str, np.ndarray]]()
        for side, joint in product(Side, JointName):
            key, own = f"{side}_{joint}_angle", convention.columns.get((side, joint))
            usual = [own] if own else []
            if convention.name == HOUSE.name:
                # The controller saw the measured angle; a log of another device may have degrees.
                usual = [f"{side}_{joint}_measured_angle_rad", *usual, f"{key}_deg"]
            if column := self._column(key, *usual):
                angles.setdefault(side, {})[joint] = convention.turned(joint, self._radians(column))
        if not angles:
            asked = (
                ", ".join(convention.columns.values()) or f"columns, of which {convention.name} names none"
            )
            way_out = "name the columns with --columns, or choose one of --convention"
            text = f"has none of {asked}; {way_out} {', '.join(CONVENTIONS)}"
            raise ParameterFileError(self.table.source, "", text)
        return angles

    def _radians(self, column: str) -> np.ndarray:
        """Angles in the unit that the name of their column says, else the file, the user, the convention."""
        table, asked = self.table, self.log_format.units
        endings = (unit for ending, unit in _UNIT_ENDINGS.items() if column.lower().endswith(ending))
        stated = next(endings, table.unit)
        if stated is not None and asked not in (None, stated):
            text = f"is in {stated} by name or header; leave --units {asked} out"
            raise ParameterFileError(table.source, column, text)
        unit = stated or asked or self.convention.unit
        if unit is None:
            text = "does not say its unit: add --units deg or --units rad"
            raise ParameterFileError(table.source, column, text)
        return np.radians(table.numbers(column)) if unit == DEGREES else table.numbers(column)
