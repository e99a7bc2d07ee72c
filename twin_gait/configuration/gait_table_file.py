"""Gait tables as YAML: units in the keys there, SI in :class:`~twin_gait.gait.table.GaitTable`."""

from __future__ import annotations

import math
from importlib.resources import files
from pathlib import Path
from typing import Any, Literal

from pydantic import Field, model_validator

from twin_gait.configuration.overrides import merge
from twin_gait.configuration.validation import Count, Number, Strict, converting, read_yaml, short, validate
from twin_gait.exceptions import GaitTableError, ParameterFileError
from twin_gait.gait.guards import AllOf, AnyOf, Guard, parse_guard
from twin_gait.gait.table import (
    LONGEST,
    SCALING_EXPONENTS,
    TICK,
    Blending,
    BlendingLaw,
    DraftTable,
    DrivenBy,
    GaitTable,
    JointImpedance,
    PhaseParameters,
    Scaling,
    Transition,
    Waiver,
)
from twin_gait.vocabulary import GaitPhase, Side

_DEGREE = math.pi / 180.0
_PER_DEGREE = 180.0 / math.pi
SCHEMA_VERSION = 1
# Far beyond any drive, mass and speed; squares and powers of such numbers still are numbers.
LARGEST, SMALLEST = 1e9, 1e-3


class JointEntry(Strict):
    """Impedance of a joint in a phase."""

    stiffness_Nm_per_deg: Number | None = Field(default=None, ge=0, le=LARGEST)
    stiffness_Nm_per_rad: Number | None = Field(default=None, ge=0, le=LARGEST * _PER_DEGREE)
    damping_Nms_per_rad: Number | None = Field(default=None, ge=0, le=LARGEST * _PER_DEGREE)
    damping_Nms_per_deg: Number | None = Field(default=None, ge=0, le=LARGEST)
    damping_ratio: Number | None = Field(default=None, ge=0, le=LARGEST)
    equilibrium_deg: Number | None = Field(default=None, ge=-LARGEST, le=LARGEST)
    equilibrium_rad: Number | None = Field(default=None, ge=-LARGEST, le=LARGEST)
    friction_compensation_gain: Number = Field(ge=0, le=1)

    @model_validator(mode="after")
    def _one_unit_each(self) -> JointEntry:
        groups = {
            "stiffness": ("stiffness_Nm_per_deg", "stiffness_Nm_per_rad"),
            "damping": ("damping_ratio", "damping_Nms_per_rad", "damping_Nms_per_deg"),
            "equilibrium": ("equilibrium_deg", "equilibrium_rad"),
        }
        for name, keys in groups.items():
            given = [key for key in keys if getattr(self, key) is not None]
            if len(given) != 1:
                raise ValueError(f"expected exactly one {name} ({' or '.join(keys)}), got {given or 'none'}")
        return self

    def convert(self) -> JointImpedance:
        """Convert to SI."""
        stiffness = self.stiffness_Nm_per_rad
        if self.stiffness_Nm_per_deg is not None:
            stiffness = self.stiffness_Nm_per_deg * _PER_DEGREE
        damping = self.damping_Nms_per_rad
        if self.damping_Nms_per_deg is not None:
            damping = self.damping_Nms_per_deg * _PER_DEGREE
        equilibrium = self.equilibrium_rad
        if self.equilibrium_deg is not None:
            equilibrium = self.equilibrium_deg * _DEGREE
        assert stiffness is not None and equilibrium is not None  # _one_unit_each checked it
        return JointImpedance(
            stiffness=stiffness,
            equilibrium_angle=equilibrium,
            friction_compensation_gain=self.friction_compensation_gain,
            damping=damping,
            damping_ratio=self.damping_ratio,
        )


_PHASE_KEYS = ("gravity_compensation", "min_time_ms")


class TransitionEntry(Strict):
    """One entry of the transition list."""

    from_: str = Field(alias="from")
    to: str
    cause: str = Field(min_length=1)
    all: list[Any] | None = None
    any: list[Any] | None = None
    after_s: Number | None = Field(default=None, gt=0, le=LONGEST * TICK)
    dwell_ms: Count | None = Field(default=None, ge=1)
    driven_by: DrivenBy = DrivenBy.JOINT

    @model_validator(mode="after")
    def _one_condition(self) -> TransitionEntry:
        if self.all is not None and self.any is not None:
            raise ValueError("give either all or any at this level; nest the other inside it")
        if self.all is None and self.any is None and self.after_s is None:
            raise ValueError("has no condition: give all, any or after_s")
        if self.all == [] or self.any == []:
            raise ValueError("the list of guards is empty")
        return self


class BlendingEntry(Strict):
    """Blending of the parameters."""

    law: BlendingLaw = BlendingLaw.MINIMUM_JERK
    duration_ms: Count = Field(default=60, ge=0, le=2000)


class ScalingEntry(Strict):
    """Scaling laws."""

    carried_mass_kg: Number | None = Field(default=None, ge=SMALLEST, le=LARGEST)
    carried_mass_exponent: Number = 1.0
    stance_phases: tuple[str, ...] = ()
    speed_m_per_s: Number | None = Field(default=None, ge=SMALLEST, le=LARGEST)
    speed_exponent: Number = 0.0
    height_m: Number | None = Field(default=None, ge=SMALLEST, le=LARGEST)
    height_exponent: Number = 0.0
    hip_centre_deg: Number | None = Field(default=None, ge=-LARGEST, le=LARGEST)
    hip_centre_rad: Number | None = Field(default=None, ge=-LARGEST, le=LARGEST)

    @model_validator(mode="after")
    def _one_centre(self) -> ScalingEntry:
        if self.hip_centre_deg is not None and self.hip_centre_rad is not None:
            raise ValueError("give either hip_centre_deg or hip_centre_rad")
        return self


class WaiverEntry(Strict):
    """A warning of the check that the table lives with."""

    rule: str = Field(min_length=1)
    reason: str = Field(min_length=1)
    phase: str | None = None
    transition: str | None = None

    def convert(self) -> Waiver:
        """Convert."""
        return Waiver(rule=self.rule, reason=self.reason, phase=self.phase, transition=self.transition)


def _hip_centre(entry: ScalingEntry) -> float:
    if entry.hip_centre_rad is not None:
        return entry.hip_centre_rad
    return 0.0 if entry.hip_centre_deg is None else entry.hip_centre_deg * _DEGREE


class GaitTableFile(Strict):
    """A gait table file."""

    schema_version: Literal[1]
    name: str | None = None
    description: str = ""
    joints: list[str] = Field(min_length=1)
    blending: BlendingEntry = BlendingEntry()
    scaling: ScalingEntry = ScalingEntry()
    phases: dict[str, dict[str, Any]] = Field(min_length=1)
    transitions: list[TransitionEntry]
    cycles: list[list[str]] = Field(default_factory=list)
    waive: list[WaiverEntry] = Field(default_factory=list)
    sides: dict[Side, dict[str, dict[str, Any]]] = Field(default_factory=dict)


def load_gait_table(path: str | Path, *, draft: bool = False) -> GaitTable:
    """Read a gait table from a YAML file.

    Args:
        path: The file.
        draft: Whether phases may lack exits or be out of reach, which a check reports itself.

    Returns:
        The table.

    Raises:
        ParameterFileError: If the file has a mistake; the message names file, key and value.
    """
    path = Path(path)
    return gait_table_from_mapping(read_gait_table(path), str(path), path.stem, draft=draft)


def read_gait_table(path: Path) -> dict[str, Any]:
    """Read a gait table file as a mapping, laid over the table that it extends.

    Args:
        path: The file.

    Returns:
        The mapping, without ``extends``.

    Raises:
        ParameterFileError: If a file has a mistake, or a chain of tables comes back to where it began.
    """
    return extended_table(read_yaml(path), path)


def extended_table(data: dict[str, Any], path: Path, below: tuple[Path, ...] = ()) -> dict[str, Any]:
    """Lay a table over the one that its key ``extends`` names.

    Mappings are laid over each other key by key, as presets are. Transitions and waivers follow those of the
    table underneath, which therefore come first where two exits are due at once. The name is not taken over.

    Args:
        data: The parsed file.
        path: Where it stands; a relative path starts from its folder.
        below: Files of the tables that extend this one.

    Returns:
        The mapping, without ``extends``; itself where there is none.

    Raises:
        ParameterFileError: If there is no such table, or the chain comes back to where it began.
    """
    if "extends" not in data:
        return data
    found = _extended_file(data["extends"], path)
    chain = (*below, path.resolve())
    if found.resolve() in chain:
        raise ParameterFileError(path, "extends", f"{data['extends']!r} extends this table itself")
    base = extended_table(read_yaml(found), found, chain)
    rest = {key: value for key, value in data.items() if key != "extends"}
    for key in ("transitions", "waive"):
        rest[key] = [*_listed(base, key, found), *_listed(rest, key, path)]
    return merge({key: value for key, value in base.items() if key != "name"}, rest)


def _extended_file(name: Any, path: Path) -> Path:
    if isinstance(name, str):
        for candidate in (path.parent / name, Path(name).expanduser(), _tables() / f"{name}.yaml"):
            if candidate.is_file():
                return candidate
    known = ", ".join(packaged_gait_tables())
    raise ParameterFileError(path, "extends", f"no gait table {name!r}: neither a file nor one of {known}")


def _listed(data: dict[str, Any], key: str, path: Path) -> list[Any]:
    items = data.get(key) or []
    if not isinstance(items, list):
        raise ParameterFileError(path, key, f"expected a list, got {short(items)}")
    return items


def packaged_gait_table(name: str) -> GaitTable:
    """Read a gait table that ships with the package.

    Args:
        name: For example ``treadmill``.

    Returns:
        The table.

    Raises:
        GaitTableError: If there is no such table.
    """
    return load_gait_table(packaged_table_path(name))


def packaged_table_path(name: str) -> Path:
    """File of a gait table that ships with the package.

    Args:
        name: For example ``treadmill``.

    Returns:
        The path.

    Raises:
        GaitTableError: If there is no such table.
    """
    if name not in packaged_gait_tables():
        raise GaitTableError(f"no gait table {name!r} ships; there are {', '.join(packaged_gait_tables())}")
    return _tables() / f"{name}.yaml"


def packaged_gait_tables() -> list[str]:
    """Names of the gait tables that ship with the package."""
    return sorted(path.stem for path in _tables().glob("*.yaml"))


def _tables() -> Path:
    return Path(str(files("twin_gait.configuration"))) / "tables"


def gait_table_from_mapping(
    data: dict[str, Any], source: str, name: str, *, draft: bool = False
) -> GaitTable:
    """Turn parsed YAML into a gait table.

    Args:
        data: The parsed file.
        source: File name for messages.
        name: Name of the table if the file gives none.
        draft: Whether to make a :class:`~twin_gait.gait.table.DraftTable`, which need not be closed.

    Returns:
        The table.

    Raises:
        ParameterFileError: If something is wrong.
    """
    entry = validate(GaitTableFile, data, source)
    joints = tuple(entry.joints)
    phases = {
        phase: _phase(values, joints, source, f"phases.{phase}") for phase, values in entry.phases.items()
    }
    # Some of the five phases are a mistake, unless the table says how it goes round without the others.
    if set(phases) < {str(item) for item in GaitPhase} and not entry.cycles:
        missing = ", ".join(str(item) for item in GaitPhase if item not in phases)
        raise ParameterFileError(
            source, "phases", f"missing {missing}; a cycle without them goes under cycles"
        )
    names = tuple(phases)
    transitions = tuple(
        _transition(item, joints, names, source, f"transitions[{index}]")
        for index, item in enumerate(entry.transitions)
    )
    side_phases = {
        side: {
            phase: _phase(
                _merged(entry, phase, values, source, side), joints, source, f"sides.{side}.{phase}"
            )
            for phase, values in differences.items()
        }
        for side, differences in entry.sides.items()
        if differences
    }
    scaling = entry.scaling
    kind = DraftTable if draft else GaitTable
    return converting(
        source,
        "",
        lambda: kind(
            name=entry.name or name,
            joints=joints,
            phases=phases,
            transitions=transitions,
            blending=Blending(law=entry.blending.law, duration_ticks=entry.blending.duration_ms),
            side_phases=side_phases,
            scaling=Scaling(
                carried_mass=scaling.carried_mass_kg,
                height=scaling.height_m,
                stance_phases=scaling.stance_phases,
                speed=scaling.speed_m_per_s,
                **{name: getattr(scaling, name) for name in SCALING_EXPONENTS},
                hip_centre=_hip_centre(scaling),
            ),
            description=entry.description,
            cycles=tuple(tuple(cycle) for cycle in entry.cycles),
            waivers=tuple(item.convert() for item in entry.waive),
        ),
    )


def _merged(
    entry: GaitTableFile, phase: str, differences: dict[str, Any], source: str, side: Side
) -> dict[str, Any]:
    """Lay the differences of one side over the common values of a phase."""
    if phase not in entry.phases:
        known = ", ".join(entry.phases)
        raise ParameterFileError(source, f"sides.{side}.{phase}", f"no such phase; there are {known}")
    return merge(entry.phases[phase], differences)


def _phase(values: dict[str, Any], joints: tuple[str, ...], source: str, key: str) -> PhaseParameters:
    for name in values:
        if name not in (*joints, *_PHASE_KEYS):
            allowed = ", ".join((*joints, *_PHASE_KEYS))
            raise ParameterFileError(source, f"{key}.{name}", f"unknown key; allowed: {allowed}")
    for joint in joints:
        if not isinstance(values.get(joint), dict):
            raise ParameterFileError(source, f"{key}.{joint}", "is missing; expected an impedance")
    entries = {joint: _at(JointEntry, values[joint], source, f"{key}.{joint}") for joint in joints}
    rest = _at(PhaseRest, {name: values[name] for name in _PHASE_KEYS if name in values}, source, key)
    return converting(
        source,
        key,
        lambda: PhaseParameters(
            joints={joint: item.convert() for joint, item in entries.items()},
            gravity_compensation=rest.gravity_compensation,
            minimum_ticks=rest.min_time_ms,
        ),
    )


class PhaseRest(Strict):
    """What a phase has beside its joints."""

    gravity_compensation: Number = Field(default=0.0, ge=0, le=1)
    min_time_ms: Count = Field(default=0, ge=0)


def _at(model: type[Any], data: Any, source: str, key: str) -> Any:
    """Validate a part of the file, with its place in front of the key."""
    try:
        return validate(model, data, source)
    except ParameterFileError as error:
        problem = str(error).split(f"{error.key}: ", 1)[-1] if error.key else str(error).split(": ", 1)[-1]
        raise ParameterFileError(source, f"{key}.{error.key}".rstrip("."), problem) from error


def _transition(
    entry: TransitionEntry, joints: tuple[str, ...], phases: tuple[str, ...], source: str, key: str
) -> Transition:
    def build() -> Transition:
        guard: Guard = AllOf(guards=())
        if entry.all is not None:
            guard = AllOf(guards=tuple(_guard(item, joints, phases) for item in entry.all))
        elif entry.any is not None:
            guard = AnyOf(guards=tuple(_guard(item, joints, phases) for item in entry.any))
        return Transition(
            source=entry.from_,
            target=entry.to,
            cause=entry.cause,
            guard=guard,
            dwell_ticks=1 if entry.dwell_ms is None else entry.dwell_ms,
            time_out_ticks=None if entry.after_s is None else round(entry.after_s / TICK),
            driven_by=entry.driven_by,
        )

    return converting(source, key, build)


def _guard(item: Any, joints: tuple[str, ...], phases: tuple[str, ...]) -> Guard:
    if isinstance(item, str):
        return parse_guard(item, joints, phases)
    if isinstance(item, dict) and len(item) == 1:
        ((kind, inner),) = item.items()
        if kind in ("all", "any") and isinstance(inner, list) and inner:
            guards = tuple(_guard(part, joints, phases) for part in inner)
            return AllOf(guards=guards) if kind == "all" else AnyOf(guards=guards)
    raise GaitTableError(
        f"guard {short(item)}: expected a text such as 'hip.angle_deg < -8', or all: / any: with a list"
    )
