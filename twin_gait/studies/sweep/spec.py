"""Sweep specifications as YAML: the schema, and its conversion to a base experiment and a design."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from pydantic import Field

from twin_gait.configuration.documents import content_hash
from twin_gait.configuration.experiment_file import experiment_from_mapping
from twin_gait.configuration.experiments import load_experiment, resolved_document
from twin_gait.configuration.overrides import assign, parse_assignments
from twin_gait.configuration.validation import Count, Number, Strict, converting, read_yaml, validate
from twin_gait.exceptions import ParameterError, ParameterFileError
from twin_gait.experiment import Experiment
from twin_gait.runs.summary import versions
from twin_gait.studies.batch import SUMMARY_COLUMNS
from twin_gait.studies.jobs import sources_hash
from twin_gait.studies.sweep.design import Design, Levels, Range, Scale, grid, latin_hypercube, listed

SPEC_SCHEMA_VERSION = 1


class RangeEntry(Strict):
    """A range of numbers."""

    start: Number = Field(alias="from")
    stop: Number = Field(alias="to")
    count: Count | None = None
    scale: Scale = Scale.LINEAR

    def convert(self) -> Range:
        """Convert."""
        return Range(start=self.start, stop=self.stop, count=self.count, scale=self.scale)


class SweepFile(Strict):
    """A sweep specification."""

    schema_version: Literal[1] = 1
    name: str = Field(default="", max_length=200)
    experiment: str | dict[str, Any] = "treadmill"
    settings: dict[str, Any] = Field(default_factory=dict)
    method: Literal["grid", "latin_hypercube", "list"]
    parameters: dict[str, Any] = Field(default_factory=dict)
    episodes: list[dict[str, Any]] = Field(default_factory=list)
    samples: Count | None = Field(default=None, ge=1)
    repetitions: Count = Field(default=1, ge=1)
    seed: Count = Field(default=0, ge=0)
    measures: list[str] = Field(default_factory=list)
    provenance: dict[str, Any] | None = None


@dataclass(frozen=True)
class Sweep:
    """A sweep with everything resolved.

    Attributes:
        source: File that it was read from, for messages.
        name: For titles.
        experiment: What all episodes have in common.
        design: What each changes.
        seed: That each episode's own seed is drawn from, with its number.
        measures: Columns that are drawn.
        document: The specification with the whole experiment in it and the hashes and versions of what
            made it; reading it gives the same sweep.
    """

    source: str
    name: str
    experiment: Experiment
    design: Design
    seed: int
    measures: tuple[str, ...]
    document: Mapping[str, Any]

    @property
    def sha256(self) -> str:
        """Hash of specification, experiment, versions and sources; equal hashes give equal tables."""
        return content_hash(dict(self.document))


def load_sweep(path: Path, settings: Sequence[str] = ()) -> Sweep:
    """Read a sweep specification.

    Args:
        path: The YAML file.
        settings: Assignments such as ``duration_s=5``, laid over the settings of the file.

    Returns:
        The sweep.

    Raises:
        ParameterFileError: If the file has a mistake.
        ParameterError: If an assignment or the experiment that it names does.
    """
    path = Path(path).expanduser()
    if path.is_dir():
        raise ParameterError(f"{path}: expected a sweep specification (YAML), got a folder")
    return sweep_from_mapping(read_yaml(path), str(path), path.parent, path.stem, settings)


def sweep_from_mapping(
    data: Mapping[str, Any], source: str, folder: Path, name: str = "sweep", settings: Sequence[str] = ()
) -> Sweep:
    """Turn a mapping into a sweep.

    Raises:
        ParameterFileError: If the mapping has a mistake.
        ParameterError: If an assignment or the experiment that it names does.
    """
    entry = validate(SweepFile, _plain(data, source), source)
    assignments = [f"{key}={json.dumps(value)}" for key, value in entry.settings.items()] + list(settings)
    experiment, typed = _experiment(entry.experiment, assignments, source, folder)
    design = _design(entry, source)
    _check_measures(entry.measures, source)
    document = {
        "schema_version": SPEC_SCHEMA_VERSION,
        "name": entry.name or name,
        "experiment": _experiment_document(experiment, typed),
        **{key: data[key] for key in ("method", "parameters", "episodes", "samples") if key in data},
        "repetitions": entry.repetitions,
        "seed": entry.seed,
        "measures": entry.measures,
        "provenance": {"sources_sha256": sources_hash(), "versions": versions()},
    }
    return Sweep(source, entry.name or name, experiment, design, entry.seed, tuple(entry.measures), document)


def _experiment(
    given: str | Mapping[str, Any], assignments: Sequence[str], source: str, folder: Path
) -> tuple[Experiment, dict[str, Any]]:
    if isinstance(given, str):
        beside = folder / given
        loaded = load_experiment(beside if beside.is_file() else given, assignments)
        return loaded.experiment, loaded.document
    document = dict(given)
    for keys, value in parse_assignments(assignments):
        document = assign(document, keys, value)
    return experiment_from_mapping(document, f"{source}: experiment", folder), document


def _experiment_document(experiment: Experiment, typed: dict[str, Any]) -> dict[str, Any]:
    """The experiment with the hashes of URDF and table; the versions stand once, beside it.

    An integrator that was left to the engine stays so: an episode may change the engine.
    """
    document = resolved_document(experiment, typed, {})
    hashes = {key: value for key, value in document["provenance"].items() if key != "versions"}
    if experiment.integration is None:
        del document["integration"]
    return {**document, "provenance": hashes}


def _plain(data: Mapping[str, Any], source: str) -> dict[str, Any]:
    """The mapping as JSON has it; YAML also knows dates and sets, which no parameter is."""
    try:
        plain: dict[str, Any] = json.loads(json.dumps(data))
    except (TypeError, ValueError, RecursionError) as error:
        raise ParameterFileError(
            source, "", f"expected numbers, texts, lists and mappings ({error})"
        ) from error
    return plain


def _design(entry: SweepFile, source: str) -> Design:
    _check_fields(entry, source)
    if entry.method == "list":
        return converting(source, "episodes", lambda: listed(entry.episodes, entry.repetitions))
    parameters = {key: _levels(key, value, source) for key, value in entry.parameters.items()}
    if entry.method == "grid":
        return converting(source, "parameters", lambda: grid(parameters, entry.repetitions))
    samples = entry.samples
    if samples is None:
        raise ParameterFileError(source, "samples", "is missing; a latin_hypercube needs their number")
    return converting(
        source, "samples", lambda: latin_hypercube(parameters, samples, entry.seed, entry.repetitions)
    )


def _check_fields(entry: SweepFile, source: str) -> None:
    """A key that the method does not use is a misunderstanding."""
    needed = "episodes" if entry.method == "list" else "parameters"
    if not getattr(entry, needed):
        raise ParameterFileError(source, needed, f"is missing or empty; method {entry.method} needs it")
    unused = "parameters" if entry.method == "list" else "episodes"
    if getattr(entry, unused):
        raise ParameterFileError(source, unused, f"method {entry.method} does not use it; see {needed}")
    if entry.method != "latin_hypercube" and entry.samples is not None:
        raise ParameterFileError(source, "samples", f"method {entry.method} does not use it; remove it")


def _levels(key: str, value: Any, source: str) -> Levels:
    place = f"parameters.{key}"
    if isinstance(value, dict):
        entry = validate(RangeEntry, value, f"{source}: {place}")
        return converting(source, place, entry.convert)
    if isinstance(value, list) and value:
        return value
    raise ParameterFileError(
        source,
        place,
        f"expected a list of values or {{from: …, to: …}}, got {json.dumps(value, default=str)}",
    )


def _check_measures(names: Sequence[str], source: str) -> None:
    for name in names:
        if name not in SUMMARY_COLUMNS or name == "status":
            raise ParameterFileError(
                source, "measures", f"no measure {name!r}; see the columns of the table of any sweep"
            )
