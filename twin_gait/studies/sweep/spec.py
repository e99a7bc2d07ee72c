"""Specifications of sweeps as YAML, their experiment, design (grid, Latin hypercube, list) and episodes."""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import ConfigDict, Field, model_validator

from twin_gait.configuration import validation
from twin_gait.configuration.experiments import (
    LoadedExperiment,
    experiment_from_mapping,
    load_experiment,
    load_named_document,
    resolved_document,
)
from twin_gait.configuration.gait_table_file import resolve_path
from twin_gait.configuration.validation import Count, Number, Strict, convert_with_context, validate
from twin_gait.exceptions import ParameterFileError
from twin_gait.experiment.experiment import Experiment
from twin_gait.files import shipped_file
from twin_gait.runs.summary import software_versions
from twin_gait.runs.user_files import FILES_FOLDER, StoredFile, referenced_files, stored_file
from twin_gait.simulation.simulation_setup import build_setup
from twin_gait.studies.batch import (
    FILES,
    REPLACEABLE_KEYS,
    SUMMARY_COLUMNS,
    Named,
    Override,
    apply_override,
    attach_document,
    named_file,
    value_to_text,
)
from twin_gait.studies.jobs import sources_hash

MOST_EPISODES = 10_000_000


class Range(Strict):
    """A range of numbers, in the unit of their key."""

    model_config = ConfigDict(populate_by_name=True)

    start: Number = Field(alias="from")
    stop: Number = Field(alias="to")
    count: Count | None = Field(default=None, ge=2, le=MOST_EPISODES)  # number of values in a grid
    scale: Literal["linear", "log"] = "linear"

    @model_validator(mode="after")
    def _ascends(self) -> Range:
        if self.start >= self.stop:
            raise ValueError(f"expected from to be below to, got {self.start:g} and {self.stop:g}")
        if self.scale == "log" and self.start <= 0.0:
            raise ValueError(f"expected from to be above 0 on a log scale, got {self.start:g}")
        return self

    def values_at(self, shares: np.ndarray) -> np.ndarray:
        """Return the values at given fractions of the range."""
        if self.scale == "log":
            return np.asarray(self.start * (self.stop / self.start) ** shares)
        return np.asarray(self.start + shares * (self.stop - self.start))


# Keys that a method needs; a key without use is rejected.
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
    strides: bool = False
    named: dict[str, dict[str, dict[str, Any]]] = Field(default_factory=dict)
    files: dict[str, str] = Field(default_factory=dict)
    provenance: dict[str, Any] | None = None


Episode = tuple[int, Override]  # number of the episode, and its changes


@dataclass(frozen=True, eq=False)
class Sweep:
    """A sweep with all names resolved."""

    source: str  # file from which it was read, for messages
    experiment: Experiment  # common experiment of all episodes
    overrides: Sequence[Override]  # changes of each episode
    # specification with the whole experiment, and with hashes and versions of the software; reading it
    # gives the same sweep
    document: Mapping[str, Any]
    files: Sequence[StoredFile]  # files that experiment and overrides name; the document names their copies

    @property
    def has_strides(self) -> bool:
        """Whether the strides of all episodes are kept."""
        return bool(self.document.get("strides"))

    def maker(self) -> Callable[[Episode], Experiment]:
        """Return a function that creates the experiment of an episode, in any process.

        Errors of the function name episode and key.
        """
        originals = {file.name: str(file.path) for file in self.files}
        files = {given: originals.get(name, name) for given, name in self.document["files"].items()}
        known = {**self.document["named"], FILES: files}
        return partial(_make_episode, attach_document(self.experiment), self.document["seed"], known)


def load_sweep(path: Path, settings: Sequence[str] = ()) -> Sweep:
    """Read a sweep specification; settings such as ``duration_s=5`` override those of the file.

    Raises ParameterFileError if the file has a mistake. Raises ParameterError if an assignment or the named
    experiment has a mistake.
    """
    path = Path(path).expanduser()
    return sweep_from_mapping(validation.read_yaml(path), str(path), path.parent, path.stem, settings)


def sweep_from_mapping(
    data: Mapping[str, Any], source: str, folder: Path, name: str = "sweep", settings: Sequence[str] = ()
) -> Sweep:
    """Convert a mapping to a sweep; errors are those of :func:`load_sweep`."""
    try:  # YAML also has dates and sets, which are no parameters
        plain = json.loads(json.dumps(data))
    except (TypeError, ValueError, RecursionError) as error:
        expected = f"expected numbers, texts, lists and mappings ({error})"
        raise ParameterFileError(source, "", expected) from error
    entry = validate(SweepFile, plain, source)
    for measure in entry.measures:
        if measure not in SUMMARY_COLUMNS or measure in ("status", "outcome"):
            problem = f"there is no measure {measure!r}; expected a column of the table of a sweep"
            raise ParameterFileError(source, "measures", problem)
    assignments = [f"{key}={json.dumps(value)}" for key, value in entry.settings.items()] + list(settings)
    loaded = _experiment(entry.experiment, assignments, source, folder)
    overrides = make_overrides(entry, source)
    references = referenced_files(loaded.experiment)
    more = _override_files(entry.files, overrides, folder, len(references))
    document = {
        "schema_version": entry.schema_version,
        "name": entry.name or name,
        "experiment": _experiment_document(loaded, references),
        **{key: data[key] for key in ("method", "parameters", "episodes", "samples") if key in data},
        "seed": entry.seed,
        "measures": entry.measures,
        **({"strides": True} if entry.strides else {}),
        "named": _named(entry.named, overrides, folder / Path(source).name),
        "files": {given: file.name for given, file in more.items()},
        "provenance": {"sources_sha256": sources_hash(), "versions": software_versions()},
    }
    return Sweep(source, loaded.experiment, overrides, document, [*references, *more.values()])


def _override_files(
    known: Mapping[str, str], overrides: Sequence[Override], folder: Path, count: int
) -> dict[str, StoredFile]:
    """Find the files that overrides name, in ``folder`` first; return them by the names as they are given.

    ``known``: their copies in ``folder``, if it is the folder of a sweep. Each copy has a subfolder of its
    own, numbered from ``count``, because files and their meshes may have the same names.
    """
    found: dict[str, StoredFile] = {}
    copies: dict[Path, StoredFile] = {}
    for file in (named_file(*item) for override in overrides for item in override.items()):
        if file is None or file.given in found:
            continue
        name = known.get(file.given, file.given)
        path = Path(resolve_path(folder, name))
        path = path if path.is_file() else shipped_file(name) or path
        if not path.is_file():  # the check of its episode reports it
            continue
        stored = copies.get(path) or stored_file(file.section, path, f"{FILES_FOLDER}/{count + len(copies)}")
        if stored.is_copied:
            copies[path] = stored
        found[file.given] = stored
    return found


def _named(known: Named, overrides: Sequence[Override], path: Path) -> Named:
    """Return the documents of the wearers and gait tables that the values name; once read they are kept."""
    named = {key: dict(known.get(key, {})) for key in REPLACEABLE_KEYS}
    for key, value in (item for override in overrides for item in override.items()):
        if key in REPLACEABLE_KEYS and value_to_text(value) not in named[key]:
            document = load_named_document(key, value, path)
            if document is not None:
                named[key][value_to_text(value)] = document
    return named


def _experiment(
    given: str | Mapping[str, Any], assignments: Sequence[str], source: str, folder: Path
) -> LoadedExperiment:
    if isinstance(given, str):
        path = folder / given
        return load_experiment(path if path.is_file() else given, assignments)
    document = dict(given)
    for keys, value in validation.parse_assignments(assignments):
        document = validation.assign(document, keys, value)
    return LoadedExperiment(experiment_from_mapping(document, f"{source}: experiment", folder), document)


def _experiment_document(loaded: LoadedExperiment, files: Sequence[StoredFile]) -> dict[str, Any]:
    """Return the experiment with hashes of URDF and table and with the names of its stored files.

    An integrator that depends on the engine is left out, because an episode may change the engine.
    """
    names = {file.section: file.name for file in files}
    document = resolved_document(loaded.experiment, loaded.document, {}, names)
    if loaded.experiment.integration is None:
        del document["integration"]
    return document


def make_overrides(entry: SweepFile, source: str) -> list[Override]:
    """Return the changes of each episode.

    In a grid the first key changes slowest. A Latin hypercube divides each range into as many slices as there
    are samples, and uses each once.
    """
    for key in ("episodes", "samples", "parameters"):
        needed = key in _NEEDED[entry.method]
        if needed != bool(getattr(entry, key)):
            missing = f"is missing or empty; the method {entry.method} requires it"
            unused = f"the method {entry.method} does not use it; leave it out"
            raise ParameterFileError(source, key, missing if needed else unused)
    levels = {key: _levels(key, value, entry.method, source) for key, value in entry.parameters.items()}
    count = entry.samples or len(entry.episodes) or math.prod(map(len, levels.values()))
    if count > MOST_EPISODES:
        problem = f"expected at most {MOST_EPISODES} episodes, got {count}"
        raise ParameterFileError(source, "", problem)
    if entry.method == "list":
        return list(entry.episodes)
    grid = entry.method == "grid"
    points = itertools.product(*levels.values()) if grid else _drawn(levels.values(), count, entry.seed)
    return [dict(zip(levels, point, strict=True)) for point in points]


def _levels(key: str, value: Any, method: str, source: str) -> Any:
    """Return the values of a parameter; for a Latin hypercube they may be a range."""
    key_path = f"parameters.{key}"
    if isinstance(value, list) and value:
        return value
    if not isinstance(value, dict):
        expected = f"expected a list of values or {{from: …, to: …}}, got {json.dumps(value)}"
        raise ParameterFileError(source, key_path, expected)
    found = validate(Range, value, f"{source}: {key_path}")
    if method != "grid":
        return found
    if found.count is None:
        raise ParameterFileError(source, key_path, "expected a count of 2 or more values of the grid")
    space = np.geomspace if found.scale == "log" else np.linspace  # both ends are exact
    return space(found.start, found.stop, found.count).tolist()


def _drawn(levels: Collection[Any], samples: int, seed: int) -> Iterator[tuple[Any, ...]]:
    from scipy.stats import qmc  # takes longer to import than a hundred walks to check

    drawn = qmc.LatinHypercube(len(levels), rng=np.random.default_rng(seed)).random(samples)
    columns = (
        item.values_at(shares).tolist()
        if isinstance(item, Range)
        else [item[int(share * len(item))] for share in shares.tolist()]
        for item, shares in zip(levels, drawn.T, strict=True)
    )
    return zip(*columns, strict=True)


def _make_episode(base: LoadedExperiment, seed: int, named: Named, episode: Episode) -> Experiment:
    """Return the experiment of an episode, with a seed of its own."""
    number, override = episode
    draws = np.random.SeedSequence(seed, spawn_key=(number,))
    changes = {"seed": int(draws.generate_state(1, np.uint64)[0])}
    seeded = replace(base, document=base.document | changes)
    return apply_override(seeded, override, f"episode {number}", named)


def check_episode(make_experiment: Callable[[Episode], Experiment], episode: Episode) -> None:
    """Check the overrides of an episode; ``make_experiment`` is the function from :meth:`Sweep.maker`."""
    experiment, (number, override) = make_experiment(episode), episode
    # A text may name a joint or phase that does not exist; numbers are checked by their ranges.
    plain = all(isinstance(value, int | float) for value in override.values())
    if number == 0 or not plain:
        convert_with_context(f"episode {number}", "", partial(build_setup, experiment))
