"""Specifications of sweeps as YAML, their experiment, design (grid, Latin hypercube, list) and episodes.

What an episode changes is made when it is asked for, so that a million of them take no memory.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import ConfigDict, Field, model_validator

from twin_gait.configuration import LoadedExperiment, experiment_from_mapping, validation
from twin_gait.configuration.documents import content_hash
from twin_gait.configuration.experiments import load_experiment, resolved_document
from twin_gait.configuration.validation import Count, Number, Strict, converting, validate
from twin_gait.exceptions import ParameterError, ParameterFileError
from twin_gait.experiment import Experiment
from twin_gait.runs.summary import versions
from twin_gait.simulation.problem import build_problem
from twin_gait.studies.batch import SUMMARY_COLUMNS, WHOLE, Named, changed, read_named, with_document
from twin_gait.studies.jobs import sources_hash

MOST_EPISODES = 10_000_000


class Range(Strict):
    """A range of numbers, in the unit of their key."""

    model_config = ConfigDict(populate_by_name=True)

    start: Number = Field(alias="from")
    stop: Number = Field(alias="to")
    count: Count | None = Field(default=None, ge=2)  # values that a grid takes of it
    scale: Literal["linear", "log"] = "linear"

    @model_validator(mode="after")
    def _ascends(self) -> Range:
        if self.start >= self.stop:
            raise ValueError(f"expected from below to, got {self.start:g} and {self.stop:g}")
        if self.scale == "log" and self.start <= 0.0:
            raise ValueError(f"expected from above 0 on a log scale, got {self.start:g}")
        return self

    def at(self, share: float) -> float:
        """Value at a share of the way; both ends are exact."""
        if share in (0.0, 1.0):
            return self.stop if share else self.start
        if self.scale == "log":
            return math.exp((1.0 - share) * math.log(self.start) + share * math.log(self.stop))
        return (1.0 - share) * self.start + share * self.stop


Levels = Range | Sequence[Any]


@dataclass(frozen=True, eq=False)
class Design(Sequence[Mapping[str, Any]]):
    """Overrides of every episode: each point ``repetitions`` times in a row; made when it is asked for."""

    keys: tuple[str, ...]  # what some point overrides
    points: int
    point: Callable[[int], Mapping[str, Any]]  # overrides of one, by its number
    repetitions: int = 1

    def __post_init__(self) -> None:
        _check_size(len(self))

    def __len__(self) -> int:
        return self.points * self.repetitions

    def __getitem__(self, index: Any) -> Any:
        if not 0 <= index < len(self):
            raise IndexError(index)
        return self.point(index // self.repetitions)

    def column(self, key: str) -> list[Any]:
        """Values of a key over all episodes; None where it is not changed."""
        return [point.get(key) for point in self]


def _check_size(episodes: int) -> None:
    if not 1 <= episodes <= MOST_EPISODES:
        raise ParameterError(f"expected 1 to {MOST_EPISODES} episodes, got {episodes}")


def grid(parameters: Mapping[str, Levels], repetitions: int = 1) -> Design:
    """Every combination; the first key changes slowest."""
    levels = {key: _values(key, item) for key, item in parameters.items()}
    sizes = [len(values) for values in levels.values()]

    def point(number: int) -> dict[str, Any]:
        places = np.unravel_index(number, sizes)
        return {key: levels[key][int(place)] for key, place in zip(levels, places, strict=True)}

    return Design(tuple(levels), math.prod(sizes), point, repetitions)


def _values(key: str, item: Levels) -> Sequence[Any]:
    if not isinstance(item, Range):
        return item
    if item.count is None:
        raise ParameterError(f"{key}: expected a count of 2 or more values of the grid")
    return [item.at(number / (item.count - 1)) for number in range(item.count)]


def latin_hypercube(
    parameters: Mapping[str, Levels], samples: int, seed: int, repetitions: int = 1
) -> Design:
    """A Latin hypercube: each range is cut into as many slices as there are samples, each used once."""
    from scipy.stats import qmc  # takes longer to import than a hundred walks to check

    _check_size(samples * repetitions)
    drawn = qmc.LatinHypercube(len(parameters), rng=np.random.default_rng(seed)).random(samples)

    def point(number: int) -> dict[str, Any]:
        shares = zip(parameters.items(), drawn[number].tolist(), strict=True)
        return {
            key: item.at(share) if isinstance(item, Range) else item[int(share * len(item))]
            for (key, item), share in shares
        }

    return Design(tuple(parameters), samples, point, repetitions)


def listed(rows: Sequence[Mapping[str, Any]], repetitions: int = 1) -> Design:
    """The rows of a list, which need not change the same keys."""
    keys = dict.fromkeys(key for row in rows for key in row)
    return Design(tuple(keys), len(rows), rows.__getitem__, repetitions)


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
    named: dict[str, dict[str, dict[str, Any]]] = Field(default_factory=dict)
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
    return sweep_from_mapping(validation.read_yaml(path), str(path), path.parent, path.stem, settings)


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
        if measure not in SUMMARY_COLUMNS or measure in ("status", "outcome"):
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
        "named": _named(entry, folder / Path(source).name),
        "provenance": {"sources_sha256": sources_hash(), "versions": versions()},
    }
    design = _design(entry, source)
    return Sweep(source, entry.name or name, experiment, design, entry.seed, tuple(entry.measures), document)


def _named(entry: SweepFile, path: Path) -> Named:
    """What the wearers and gait tables stand for that the values name; once read they are kept."""
    levels = {key: entry.parameters.get(key) for key in WHOLE}
    rows = [{key: value} for key, values in levels.items() if isinstance(values, list) for value in values]
    for row in [*rows, *entry.episodes]:
        read_named(entry.named, row, path)
    return entry.named


def _experiment(
    given: str | Mapping[str, Any], assignments: Sequence[str], source: str, folder: Path
) -> tuple[Experiment, dict[str, Any]]:
    if isinstance(given, str):
        beside = folder / given
        loaded = load_experiment(beside if beside.is_file() else given, assignments)
        return loaded.experiment, loaded.document
    document = dict(given)
    for keys, value in validation.parse_assignments(assignments):
        document = validation.assign(document, keys, value)
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


def experiment_of_episode(spec: str, number: int) -> Experiment:
    """What an episode is to run, with draws of its own; an error names episode and key.

    ``spec``: the document of the sweep as JSON; each process lays the sweep out for itself, once.
    """
    sweep, base = _laid_out(spec)
    draws = np.random.SeedSequence(sweep.seed, spawn_key=(number,))
    seed = {"seed": int(draws.generate_state(1, np.uint64)[0])}
    seeded = replace(base, document=base.document | seed)
    return changed(seeded, sweep.design[number], f"episode {number}", sweep.document["named"])


@lru_cache(maxsize=1)
def _laid_out(spec: str) -> tuple[Sweep, LoadedExperiment]:
    sweep = sweep_from_mapping(json.loads(spec), "the sweep", Path())
    return sweep, with_document(sweep.experiment)


def check_episode(spec: str, number: int) -> None:
    """Check the overrides of an episode."""
    experiment, (sweep, _) = experiment_of_episode(spec, number), _laid_out(spec)
    # A text may name a joint or phase that is not there; numbers are checked by their ranges.
    plain = all(isinstance(value, int | float) for value in sweep.design[number].values())
    if number == 0 or not plain:
        converting(f"episode {number}", "", partial(build_problem, experiment))
