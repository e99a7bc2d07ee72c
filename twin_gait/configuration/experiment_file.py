"""Experiments as YAML: the schema of a file, with units in the keys, and its conversion to SI.

Sensors and integration stand here; the larger sections have modules of their own.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

from pydantic import AfterValidator, BeforeValidator, Field, create_model, model_validator

from twin_gait.configuration.gait_table_file import gait_table_from_mapping
from twin_gait.configuration.readers import section_of
from twin_gait.configuration.sections import one_of_kinds
from twin_gait.configuration.validation import Count, Number, Strict, converting, validate
from twin_gait.exceptions import ModelError, ParameterError, ParameterFileError
from twin_gait.experiment import (
    ControlParameters,
    Engine,
    Experiment,
    Integration,
    PlantParameters,
    Scenario,
    default_integration,
)
from twin_gait.leg_model import LegJoints
from twin_gait.leg_model.urdf import find_urdf, urdf_hash
from twin_gait.network.dbc import find_dbc
from twin_gait.parameters import BraceParameters, NetworkParameters, Patient, SensorParameters
from twin_gait.vocabulary import Side
from twin_gait.worlds import BenchLeg, LegSource, Treadmill
from twin_gait.worlds.faults import Fault, parse_fault

_LegJoints: Any = section_of(LegJoints)


class LegEntry(Strict):
    """URDF and joint names."""

    urdf: str = "twin.urdf"
    left: _LegJoints | None = None  # type: ignore[valid-type]
    right: _LegJoints | None = None  # type: ignore[valid-type]
    fit_device: bool = True
    up_axis: Literal["y", "z"] = "z"

    def convert(self, folder: Path) -> LegSource:
        """Convert; a relative path is taken from the folder of the file."""
        entries = {side: getattr(self, side) for side in Side if getattr(self, side) is not None}
        legs = {side: _within(side, entry.convert) for side, entry in entries.items()}
        if not legs:
            raise ParameterError("expected the joint names of left, right or both legs")
        path = _beside(folder, self.urdf)
        find_urdf(path)
        return LegSource(urdf=path, legs=legs, fit_device=self.fit_device, up_axis=self.up_axis)

    @staticmethod
    def document(source: LegSource) -> dict[str, Any]:
        """As the mapping of a file."""
        legs = {str(side): _LegJoints.document(leg) for side, leg in source.legs.items()}
        return {"urdf": source.urdf, **legs, "fit_device": source.fit_device, "up_axis": source.up_axis}


def _within(key: str, convert: Callable[[], Any]) -> Any:
    try:
        return convert()
    except ParameterError as error:
        raise ParameterError(f"{key}.{error}") from error


def _beside(folder: Path, name: str) -> str:
    """A path from the folder of the file, if there is such a file; else the name as it is."""
    return str((folder / name).resolve()) if (folder / name).is_file() else name


def _by_word(parameters: type[Any], without: str, kind: str, implied: str = "") -> Any:
    """A section that may be a word, or a mapping with such a ``kind``.

    Args:
        without: Word for None.
        kind: Word for the parameters.
        implied: Which of them a mapping is without a ``kind``; empty where it needs one.
    """

    def as_mapping(value: Any) -> Any:
        if isinstance(value, str):
            return {"kind": value}
        if not isinstance(value, Mapping):
            raise ValueError(f"expected {without}, {kind} or a mapping with a kind, got {value!r}")
        return {"kind": implied, **value} if implied else value

    def alone(section: Any) -> Any:
        given = sorted(section.model_fields_set - {"kind"})
        if section.kind == without and given:
            raise ValueError(f"{without} has no {given[0]}: set kind to {kind}, or the whole to {without}")
        return section

    model = create_model(
        parameters.__name__,
        __base__=section_of(parameters),
        kind=(Literal[without, kind], ...),  # type: ignore[valid-type]
    )
    model.parameters = parameters
    return Annotated[model, BeforeValidator(as_mapping), AfterValidator(alone)]


_Scenario: Any = one_of_kinds((Treadmill, BenchLeg))
_Patient, _Control, _Plant, _Sensors, _Integration = map(
    section_of, (Patient, ControlParameters, PlantParameters, SensorParameters, Integration)
)
_Interface: Any = _by_word(BraceParameters, "rigid", "brace")
_Network: Any = _by_word(NetworkParameters, "ideal", "can", "can")


class ProvenanceEntry(Strict):
    """What a resolved experiment was made with."""

    urdf_sha256: str | None = None
    table_sha256: str | None = None
    versions: dict[str, str] = Field(default_factory=dict)


class ExperimentFile(Strict):
    """An experiment file, presets merged in."""

    schema_version: Literal[1] = 1
    name: str = Field(min_length=1)
    description: str = ""
    scenario: _Scenario
    leg: LegEntry
    patient: _Patient | None = None
    interface: _Interface | None = None
    table: dict[str, Any]
    duration_s: Number = 20.0
    control: _Control = _Control()
    plant: _Plant = _Plant()
    sensors: _Sensors = _Sensors()
    integration: _Integration | None = None
    engine: Engine = Engine.COMPILED
    seed: Count = 0
    faults: tuple[str, ...] = ()
    network: _Network | None = None
    provenance: ProvenanceEntry | None = None

    @model_validator(mode="after")
    def _name_is_a_word(self) -> ExperimentFile:
        if any(character in self.name for character in "/\\\0\n"):
            raise ValueError(f"name: expected a plain name, got {self.name!r}")
        return self


class Converted(NamedTuple):
    """A mapping and the experiment that it was turned into."""

    document: Mapping[str, Any]
    experiment: Experiment


def experiment_from_mapping(
    data: dict[str, Any], source: str, folder: Path, like: Converted | None = None
) -> Experiment:
    """Turn a resolved mapping (presets merged, table inline) into an experiment.

    Args:
        data: The mapping.
        source: File name for messages.
        folder: Folder that relative paths start from.
        like: One that was turned before. Sections that are the very same objects in both mappings are not
            converted again, which takes most of the time.

    Returns:
        The experiment.

    Raises:
        ParameterFileError: If something is wrong; one line with file, key and value.
    """
    entry = validate(ExperimentFile, data, source)

    def section(key: str, convert: Callable[[], Any]) -> Any:
        if like is not None and data.get(key) is like.document.get(key):
            return getattr(like.experiment, key)
        return converting(source, key, convert)

    # A table without a name has the experiment's.
    named = like if like is not None and entry.name == like.experiment.name else None
    table = (
        named.experiment.table
        if named is not None and data["table"] is named.document["table"]
        else gait_table_from_mapping(entry.table, f"{source}: table", entry.name)
    )
    scenario: Scenario = section("scenario", entry.scenario.convert)
    leg = section("leg", lambda: entry.leg.convert(folder))
    if entry.provenance is not None and entry.provenance.urdf_sha256 is not None:
        wanted = entry.provenance.urdf_sha256
        converting(source, "provenance.urdf_sha256", lambda: _check_hash(leg.urdf, wanted))
    patient = entry.patient
    return converting(
        source,
        "",
        lambda: Experiment(
            name=entry.name,
            scenario=scenario,
            leg=leg,
            table=table,
            duration=entry.duration_s,
            patient=None if patient is None else section("patient", patient.convert),
            control=section("control", entry.control.convert),
            plant=section("plant", entry.plant.convert),
            sensors=section("sensors", entry.sensors.convert),
            integration=converting(source, "integration", lambda: _integration(entry, scenario)),
            engine=entry.engine,
            seed=entry.seed,
            faults=_faults(entry, source),
            interface=section("interface", lambda: _unless(entry.interface, "rigid", BraceParameters())),
            network=section("network", lambda: _network(entry, folder)),
        ),
    )


def _unless(entry: Any, without: str, default: Any) -> Any:
    return None if entry is None or entry.kind == without else entry.convert(default)


def _network(entry: ExperimentFile, folder: Path) -> NetworkParameters | None:
    network: NetworkParameters | None = _unless(entry.network, "ideal", NetworkParameters())
    if network is None:
        return None
    dbc = _beside(folder, network.dbc)
    try:
        find_dbc(dbc)
    except ParameterFileError as error:
        raise ParameterError(f"dbc: {error}") from error
    return replace(network, dbc=dbc)


def _integration(entry: ExperimentFile, scenario: Scenario) -> Integration | None:
    if entry.integration is None:
        return None
    braced = entry.interface is not None and entry.interface.kind == "brace"
    asked: Integration = entry.integration.convert(default_integration(entry.engine, scenario, braced=braced))
    return asked


def _faults(entry: ExperimentFile, source: str) -> tuple[Fault, ...]:
    return tuple(
        converting(source, f"faults[{index}]", partial(parse_fault, text))
        for index, text in enumerate(entry.faults)
    )


def _check_hash(urdf: str, wanted: str) -> None:
    found = urdf_hash(find_urdf(urdf))
    if found != wanted:
        raise ModelError(
            f"{urdf} is not the file that this experiment was made with (sha256 {found[:12]}…, expected "
            f"{wanted[:12]}…); restore it, or remove this key to run with the file as it is"
        )
