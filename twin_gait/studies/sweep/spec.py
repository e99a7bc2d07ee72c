"""Sweep specifications as YAML, and their conversion to a base experiment and a design."""

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
from twin_gait.configuration.validation import Count, Strict, converting, read_yaml, validate
from twin_gait.exceptions import ParameterError, ParameterFileError
from twin_gait.experiment import Experiment
from twin_gait.runs.summary import versions
from twin_gait.studies.batch import SUMMARY_COLUMNS
from twin_gait.studies.jobs import sources_hash
from twin_gait.studies.sweep.design import Design, Levels, Range, grid, latin_hypercube, listed

# Keys that a method needs, and those that it does not use: a key without use is a misunderstanding.
_NEEDED = {"grid": {"parameters"}, "latin_hypercube": {"parameters", "samples"}, "list": {"episodes"}}


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
    """A sweep with everything resolved."""

    source: str  # file that it was read from, for messages
    name: str  # for titles
    experiment: Experiment  # what all episodes have in common
    design: Design  # what each changes
    seed: int  # that each episode's own seed is drawn from, with its number
    measures: tuple[str, ...]  # columns that are drawn
    # The specification with the whole experiment in it and the hashes and versions of what made it; reading
    # it gives the same sweep.
    document: Mapping[str, Any]

    @property
    def sha256(self) -> str:
        """Hash of specification, experiment, versions and sources; equal hashes give equal tables."""
        return content_hash(dict(self.document))


def load_sweep(path: Path, settings: Sequence[str] = ()) -> Sweep:
    """Read a sweep specification; settings such as ``duration_s=5`` are laid over those of the file.

    Raises ParameterFileError if the file has a mistake. Raises ParameterError if an assignment or the
    experiment that it names does.
    """
    path = Path(path).expanduser()
    if path.is_dir():
        raise ParameterError(f"{path}: expected a sweep specification (YAML), got a folder")
    return sweep_from_mapping(read_yaml(path), str(path), path.parent, path.stem, settings)


def sweep_from_mapping(
    data: Mapping[str, Any], source: str, folder: Path, name: str = "sweep", settings: Sequence[str] = ()
) -> Sweep:
    """Turn a mapping into a sweep; errors as of :func:`load_sweep`."""
    try:  # YAML also knows dates and sets, which no parameter is
        plain = json.loads(json.dumps(data))
    except (TypeError, ValueError, RecursionError) as error:
        wanted = f"expected numbers, texts, lists and mappings ({error})"
        raise ParameterFileError(source, "", wanted) from error
    entry = validate(SweepFile, plain, source)
    for measure in entry.measures:
        if measure not in SUMMARY_COLUMNS or measure == "status":
            problem = f"no measure {measure!r}; see the columns of the table of any sweep"
            raise ParameterFileError(source, "measures", problem)
    assignments = [f"{key}={json.dumps(value)}" for key, value in entry.settings.items()] + list(settings)
    experiment, typed = _experiment(entry.experiment, assignments, source, folder)
    document = {
        "schema_version": entry.schema_version,
        "name": entry.name or name,
        "experiment": _experiment_document(experiment, typed),
        **{key: data[key] for key in ("method", "parameters", "episodes", "samples") if key in data},
        "repetitions": entry.repetitions,
        "seed": entry.seed,
        "measures": entry.measures,
        "provenance": {"sources_sha256": sources_hash(), "versions": versions()},
    }
    design = _design(entry, source)
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


def _design(entry: SweepFile, source: str) -> Design:
    for key in ("episodes", "samples", "parameters"):
        needed = key in _NEEDED[entry.method]
        if needed != bool(getattr(entry, key)):
            problem = "is missing or empty; method {} needs it" if needed else "method {} does not use it"
            raise ParameterFileError(source, key, problem.format(entry.method))
    repetitions = entry.repetitions
    if entry.method == "list":
        return converting(source, "episodes", lambda: listed(entry.episodes, repetitions))
    levels = {key: _levels(key, value, source) for key, value in entry.parameters.items()}
    if entry.method == "grid":
        return converting(source, "parameters", lambda: grid(levels, repetitions))
    samples = entry.samples or 0
    return converting(source, "parameters", lambda: latin_hypercube(levels, samples, entry.seed, repetitions))


def _levels(key: str, value: Any, source: str) -> Levels:
    place = f"parameters.{key}"
    if isinstance(value, dict):
        return validate(Range, value, f"{source}: {place}")
    if isinstance(value, list) and value:
        return value
    wanted = f"expected a list of values or {{from: …, to: …}}, got {json.dumps(value)}"
    raise ParameterFileError(source, place, wanted)
