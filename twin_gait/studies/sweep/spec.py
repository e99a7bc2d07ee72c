"""Specifications of sweeps as YAML, their experiment, design (grid, Latin hypercube, list) and episodes."""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pandas as pd
from pydantic import ConfigDict, Field, model_validator

from twin_gait.configuration import LoadedExperiment, experiment_from_mapping, validation
from twin_gait.configuration.experiments import load_experiment, named_document, resolved_document
from twin_gait.configuration.validation import Count, Number, Strict, converting, validate
from twin_gait.exceptions import ParameterFileError
from twin_gait.experiment import Experiment
from twin_gait.runs.summary import versions
from twin_gait.simulation.problem import build_problem
from twin_gait.studies.batch import SUMMARY_COLUMNS, WHOLE, Named, changed, name_of, with_document
from twin_gait.studies.jobs import sources_hash

MOST_EPISODES = 10_000_000


class Range(Strict):
    """A range of numbers, in the unit of their key."""

    model_config = ConfigDict(populate_by_name=True)

    start: Number = Field(alias="from")
    stop: Number = Field(alias="to")
    count: Count | None = Field(default=None, ge=2, le=MOST_EPISODES)  # values that a grid takes of it
    scale: Literal["linear", "log"] = "linear"

    @model_validator(mode="after")
    def _ascends(self) -> Range:
        if self.start >= self.stop:
            raise ValueError(f"expected from below to, got {self.start:g} and {self.stop:g}")
        if self.scale == "log" and self.start <= 0.0:
            raise ValueError(f"expected from above 0 on a log scale, got {self.start:g}")
        return self

    def of_grid(self, count: int) -> np.ndarray:
        """So many values; both ends are exact."""
        space = np.geomspace if self.scale == "log" else np.linspace
        return np.asarray(space(self.start, self.stop, count))

    def at(self, shares: np.ndarray) -> np.ndarray:
        """Values at shares of the way."""
        if self.scale == "log":
            return np.asarray(self.start * (self.stop / self.start) ** shares)
        return np.asarray(self.start + shares * (self.stop - self.start))


# Keys that a method needs; one without use is a misunderstanding.
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
    seed: Count = Field(default=0, ge=0)
    measures: list[str] = Field(default_factory=list)
    named: dict[str, dict[str, dict[str, Any]]] = Field(default_factory=dict)
    provenance: dict[str, Any] | None = None


@dataclass(frozen=True, eq=False)
class Sweep:
    """A sweep with everything resolved."""

    source: str  # file that it was read from, for messages
    experiment: Experiment  # what all episodes have in common
    design: pd.DataFrame  # what each changes, see design_of
    # The specification with the whole experiment in it and the hashes and versions of what made it; reading
    # it gives the same sweep.
    document: Mapping[str, Any]

    def override(self, number: int) -> dict[str, Any]:
        """What an episode changes."""
        changes = self.design.iloc[number].items()
        return {
            str(key): value for key, value in changes if not (isinstance(value, float) and math.isnan(value))
        }


def load_sweep(path: Path, settings: Sequence[str] = ()) -> Sweep:
    """Read a sweep specification; settings such as ``duration_s=5`` are laid over those of the file.

    Raises ParameterFileError if the file has a mistake. Raises ParameterError if an assignment or the
    experiment that it names does.
    """
    path = Path(path).expanduser()
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
        "seed": entry.seed,
        "measures": entry.measures,
        "named": _named(entry, folder / Path(source).name),
        "provenance": {"sources_sha256": sources_hash(), "versions": versions()},
    }
    return Sweep(source, experiment, design_of(entry, source), document)


def _named(entry: SweepFile, path: Path) -> Named:
    """What the wearers and gait tables stand for that the values name; once read they are kept."""
    for key in WHOLE:
        found, levels = entry.named.setdefault(key, {}), entry.parameters.get(key)
        values = [row[key] for row in entry.episodes if key in row]
        for value in [*(levels if isinstance(levels, list) else ()), *values]:
            document = None if name_of(value) in found else named_document(key, value, path)
            if document is not None:
                found[name_of(value)] = document
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
    if experiment.integration is None:
        del document["integration"]
    return document


def design_of(entry: SweepFile, source: str) -> pd.DataFrame:
    """What each episode changes: a column of objects by key, NaN where a row of a list leaves it as it is.

    Of a grid the first key changes slowest. A Latin hypercube cuts each range into as many slices as there
    are samples, and uses each once.
    """
    for key in ("episodes", "samples", "parameters"):
        needed = key in _NEEDED[entry.method]
        if needed != bool(getattr(entry, key)):
            problem = "is missing or empty; method {} needs it" if needed else "method {} does not use it"
            raise ParameterFileError(source, key, problem.format(entry.method))
    levels = {key: _levels(key, value, entry.method, source) for key, value in entry.parameters.items()}
    count = entry.samples or len(entry.episodes) or math.prod(map(len, levels.values()))
    if count > MOST_EPISODES:
        problem = f"expected at most {MOST_EPISODES} episodes, got {count}"
        raise ParameterFileError(source, "", problem)
    points: Any = entry.episodes
    if entry.method == "grid":
        points = list(itertools.product(*levels.values()))
    elif entry.method == "latin_hypercube":
        points = _drawn(levels, count, entry.seed)
    return pd.DataFrame(points, columns=list(levels) or None, dtype=object)


def _levels(key: str, value: Any, method: str, source: str) -> Any:
    """The values of a parameter; of a Latin hypercube maybe a range."""
    place = f"parameters.{key}"
    if isinstance(value, list) and value:
        return value
    if not isinstance(value, dict):
        wanted = f"expected a list of values or {{from: …, to: …}}, got {json.dumps(value)}"
        raise ParameterFileError(source, place, wanted)
    found = validate(Range, value, f"{source}: {place}")
    if method != "grid":
        return found
    if found.count is None:
        raise ParameterFileError(source, place, "expected a count of 2 or more values of the grid")
    return found.of_grid(found.count).tolist()


def _drawn(levels: Mapping[str, Any], samples: int, seed: int) -> dict[str, list[Any]]:
    from scipy.stats import qmc  # takes longer to import than a hundred walks to check

    drawn = qmc.LatinHypercube(len(levels), rng=np.random.default_rng(seed)).random(samples)
    return {
        key: item.at(shares).tolist()
        if isinstance(item, Range)
        else [item[int(share * len(item))] for share in shares.tolist()]
        for (key, item), shares in zip(levels.items(), drawn.T, strict=True)
    }


def experiment_of_episode(spec: str, number: int) -> Experiment:
    """What an episode is to run, with draws of its own; an error names episode and key.

    ``spec``: the document of the sweep as JSON; each process lays the sweep out for itself, once.
    """
    sweep, base = _laid_out(spec)
    draws = np.random.SeedSequence(sweep.document["seed"], spawn_key=(number,))
    seed = {"seed": int(draws.generate_state(1, np.uint64)[0])}
    seeded = replace(base, document=base.document | seed)
    return changed(seeded, sweep.override(number), f"episode {number}", sweep.document["named"])


@lru_cache(maxsize=1)
def _laid_out(spec: str) -> tuple[Sweep, LoadedExperiment]:
    sweep = sweep_from_mapping(json.loads(spec), "the sweep", Path())
    return sweep, with_document(sweep.experiment)


def check_episode(spec: str, number: int) -> None:
    """Check the overrides of an episode."""
    experiment, (sweep, _) = experiment_of_episode(spec, number), _laid_out(spec)
    # A text may name a joint or phase that is not there; numbers are checked by their ranges.
    plain = all(isinstance(value, int | float) for value in sweep.override(number).values())
    if number == 0 or not plain:
        converting(f"episode {number}", "", partial(build_problem, experiment))
