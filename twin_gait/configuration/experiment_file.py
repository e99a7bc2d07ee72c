"""Experiments as YAML: the schema of a file, with units in the keys, and its conversion to SI.

Sensors and integration stand here; the larger sections have modules of their own.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, NamedTuple

from pydantic import BeforeValidator, ConfigDict, Field, create_model, model_validator

from twin_gait.configuration.device_sections import ControlEntry, InterfaceEntry, PlantEntry
from twin_gait.configuration.gait_table_file import gait_table_from_mapping
from twin_gait.configuration.network_section import NetworkEntry
from twin_gait.configuration.overrides import merge
from twin_gait.configuration.people import PatientEntry
from twin_gait.configuration.scenario_section import AnglesEntry, LegEntry, section_of_world
from twin_gait.configuration.sections import Section
from twin_gait.configuration.validation import Count, Number, Strict, converting, validate
from twin_gait.exceptions import ModelError
from twin_gait.experiment import (
    Engine,
    Experiment,
    Integration,
    IntegrationMethod,
    default_integration,
)
from twin_gait.leg_model.urdf import find_urdf, urdf_hash
from twin_gait.parameters import SensorParameters
from twin_gait.vocabulary import MOTOR_JOINTS, JointName, Side
from twin_gait.worlds import Scenario
from twin_gait.worlds.faults import Fault, parse_fault


def _zero_if_not_given(value: Any) -> Any:
    return merge({"hip_rad": 0.0, "knee_rad": 0.0}, value) if isinstance(value, Mapping) else value


OffsetsEntry = Annotated[AnglesEntry, BeforeValidator(_zero_if_not_given)]


class OffsetEntry(Strict):
    """Calibration errors of the encoders; what is not given is 0."""

    left: OffsetsEntry = AnglesEntry(hip_rad=0.0, knee_rad=0.0)
    right: OffsetsEntry = AnglesEntry(hip_rad=0.0, knee_rad=0.0)

    def convert(self) -> dict[tuple[Side, JointName], float]:
        """Those that are not 0, in SI."""
        found = {}
        for side in Side:
            angles = zip(MOTOR_JOINTS, getattr(self, side).convert(), strict=True)
            found.update({(side, joint): angle for joint, angle in angles if angle != 0.0})
        return found

    @staticmethod
    def document(offset: Mapping[tuple[Side, JointName], float]) -> dict[str, Any]:
        """As the mapping of a file, in SI."""
        return {
            str(side): {f"{joint}_rad": offset.get((side, joint), 0.0) for joint in MOTOR_JOINTS}
            for side in Side
        }


class SensorsEntry(Section):
    """Encoders and filters."""

    parameters: ClassVar = SensorParameters
    ideal: bool = SensorParameters.ideal
    encoder_counts: Count = SensorParameters.encoder_counts
    angle_noise_deg: Number | None = None
    angle_noise_rad: Number | None = None
    offset: OffsetEntry = OffsetEntry()
    fast_time_constant_s: Number = SensorParameters.fast_time_constant
    decimation: Count = SensorParameters.decimation
    window: Count = SensorParameters.window


class IntegrationEntry(Section):
    """Integrator and step."""

    parameters: ClassVar = Integration
    method: IntegrationMethod | None = None
    step_s: Number | None = None
    step_ms: Number | None = None


class ProvenanceEntry(Strict):
    """What a resolved experiment was made with."""

    urdf_sha256: str | None = None
    table_sha256: str | None = None
    versions: dict[str, str] = Field(default_factory=dict)


class ExperimentFile(Strict):
    """An experiment file, presets merged in; :func:`file_about` has the section of its world in it."""

    model_config = ConfigDict(defer_build=True)
    schema_version: Literal[1] = 1
    name: str = Field(min_length=1)
    description: str = ""
    scenario: Section
    leg: LegEntry
    patient: PatientEntry | None = None
    interface: InterfaceEntry = InterfaceEntry(kind="rigid")
    table: dict[str, Any]
    duration_s: Number = 20.0
    control: ControlEntry = ControlEntry()
    plant: PlantEntry = PlantEntry()
    sensors: SensorsEntry = SensorsEntry()
    integration: IntegrationEntry | None = None
    engine: Engine = Engine.COMPILED
    seed: Count = 0
    faults: tuple[str, ...] = ()
    network: NetworkEntry = NetworkEntry(kind="ideal")
    provenance: ProvenanceEntry | None = None

    @model_validator(mode="after")
    def _name_is_a_word(self) -> ExperimentFile:
        if any(character in self.name for character in "/\\\0\n"):
            raise ValueError(f"name: expected a plain name, got {self.name!r}")
        return self


def file_about(scenario: Any, source: str) -> type[ExperimentFile]:
    """Schema of a file, by the world that it is about."""
    if not isinstance(scenario, Mapping):
        return ExperimentFile  # which says what is wrong
    return _file_with(converting(source, "scenario.kind", lambda: section_of_world(scenario.get("kind"))))


@cache
def _file_with(section: type[Section]) -> type[ExperimentFile]:
    return create_model("ExperimentFile", __base__=ExperimentFile, scenario=(section, ...))


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
    entry = validate(file_about(data.get("scenario"), source), data, source)

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
            interface=section("interface", entry.interface.convert),
            network=section("network", lambda: entry.network.convert_in(folder)),
        ),
    )


def _integration(entry: ExperimentFile, scenario: Scenario) -> Integration | None:
    if entry.integration is None:
        return None
    standard = default_integration(entry.engine, scenario, braced=entry.interface.kind == "brace")
    return replace(standard, **entry.integration.values())


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
