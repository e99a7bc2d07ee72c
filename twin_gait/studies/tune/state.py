"""Settings, state and result of a tuning.

The state is kept on disk while it runs: one JSON file, replaced after every step, nothing pickled.
"""

import json
import reprlib
import shutil
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from importlib import metadata
from pathlib import Path
from typing import Any, NamedTuple

from twin_gait.configuration.documents import content_hash, experiment_document
from twin_gait.exceptions import ParameterError, RunDirectoryError
from twin_gait.experiment import Experiment
from twin_gait.files import write_json
from twin_gait.runs.folders import FolderKind, check_target
from twin_gait.studies.jobs import sources_hash
from twin_gait.studies.tune.parts import AIM, FALL, HELD_TO, NEEDED_CLEARANCE, WORST, Rating, parts_of
from twin_gait.studies.tune.search import Descent, Generation
from twin_gait.studies.tune.space import Parameter
from twin_gait.studies.tune.walks import NOMINAL_WEIGHT, weighted_cost

STATE_FILE = "state.json"
TUNING = FolderKind("a tuning", STATE_FILE)
SCHEMA_VERSION = 4


@dataclass(frozen=True, kw_only=True)
class Settings:
    """How a table is tuned."""

    minutes: float = 3.0  # time for everything; generations under way are finished
    # of the search; None until the time is over. With a number the result does not depend on the machine's
    # speed
    generations: int | None = None
    seed: int = 0  # of the sensor noise; the search has no chance in it
    thresholds: bool = True  # whether angle thresholds count
    blending: bool = True  # whether the duration of the blend counts
    per_side: bool = False  # whether each leg gets numbers of its own (hemiparesis)
    # whether the table is for other wearers, supports and belts too, as one that ships is: search and robust
    # set then have corner_cases in them
    everyone: bool = False
    search_duration: float = 14.0  # length of a walk in the search in [s]
    robust_duration: float = 20.0  # length of a walk of the robust set in [s]

    def __post_init__(self) -> None:
        if not 0.0 < self.minutes < float("inf"):
            raise ParameterError(f"minutes: expected a number above 0, got {self.minutes}")
        if self.generations is not None and self.generations < 1:
            raise ParameterError(f"generations: expected 1 or more, got {self.generations}")
        if self.seed < 0:
            raise ParameterError(f"seed: expected a whole number of 0 or more, got {self.seed}")


def identity(experiment: Experiment, settings: Settings) -> dict[str, Any]:
    """What makes a tuning this one: a kept state of another cannot be gone on with."""
    chosen = asdict(settings)
    del chosen["minutes"], chosen["generations"]
    return {
        "experiment": content_hash(experiment_document(experiment)),
        **chosen,
        "parts": {part.name: [part.goal, part.weight] for part in parts_of(experiment.joints)},
        "costs": [WORST, FALL, AIM, HELD_TO, NEEDED_CLEARANCE, NOMINAL_WEIGHT],
        "sources": sources_hash(),
        "versions": {"numpy": metadata.version("numpy")},
    }


@dataclass
class State:
    """How far a tuning has come."""

    identity: dict[str, Any]  # what makes it this one: experiment, seed, settings, versions
    elapsed: float = 0.0  # time that it has taken over all calls in [s]
    generations: list[Generation] = field(default_factory=list)  # of the search; the first is its start
    descent: Descent | None = None  # where it stands, or None before it


class Progress(NamedTuple):
    """Where a tuning stands."""

    stage: str  # ``compiling``, ``search`` or ``robust set``
    done: int  # of this stage: walks, or generations
    total: int | None  # in all, or None while only the time ends it
    elapsed: float  # in [s]
    costs: tuple[float, float] | None  # of the table that it began with and of the best so far, once known


@dataclass(frozen=True, eq=False)
class Finalist:
    """A table that walked the robust set."""

    table: dict[str, Any]  # its document
    # coordinates of what was searched for; None for the table that it began with
    points: tuple[float, ...] | None
    search_cost: float  # in the search
    walks: tuple[tuple[str, Rating], ...]  # name of the case and result, nominal first

    @property
    def falls(self) -> int:
        """Cases in which it fell."""
        return sum(walk.fell for _, walk in self.walks)

    @property
    def cost(self) -> float:
        """Cost over the robust set; the nominal case weighs as much as in the search."""
        return weighted_cost([walk for _, walk in self.walks])


@dataclass(frozen=True, eq=False)
class Tuning:
    """Result of a tuning."""

    parameters: tuple[Parameter, ...]  # all numbers that were searched for
    state: State  # with all generations
    before: Finalist  # the table that was to be bettered
    ranked: tuple[Finalist, ...]  # all finalists, the best first; ``before`` is one of them


def open_state(directory: Path, identity: Mapping[str, Any], *, resume: bool, force: bool) -> State:
    """Begin a tuning's folder, or read how far it has come; refuse one that holds something else."""
    plain = json.loads(json.dumps(identity))
    file = directory / STATE_FILE
    if resume and not force:
        return _read(file, plain)
    if directory.is_file() or (directory.exists() and any(directory.iterdir())):
        if not force:
            raise RunDirectoryError(
                f"{directory}: exists; go on with --resume, replace it with --force, or choose another --out"
            )
        check_target(directory, TUNING, force=True)
    try:
        if directory.exists():
            shutil.rmtree(directory)
        directory.mkdir(parents=True)
    except OSError as error:
        raise RunDirectoryError(
            f"{directory}: cannot be written ({error.strerror}); choose another --out"
        ) from error
    return State(plain)


def write_state(state: State, directory: Path) -> None:
    """Keep the state."""
    document = {
        "schema_version": SCHEMA_VERSION,
        "identity": state.identity,
        "elapsed_s": state.elapsed,
        "generations": [generation._asdict() for generation in state.generations],
        "descent": None if state.descent is None else asdict(state.descent),
    }
    write_json(directory / STATE_FILE, document)


def _read(file: Path, identity: dict[str, Any]) -> State:
    try:
        document = json.loads(file.read_text(encoding="utf-8"))
        state = State(
            document["identity"],
            float(document["elapsed_s"]),
            [Generation(**item) for item in document["generations"]],
            None if document["descent"] is None else Descent(**document["descent"]),
        )
    except OSError as error:
        raise RunDirectoryError(
            f"{file}: cannot be read ({error.strerror}); --resume goes on with a tuning that was begun, "
            "leave it out to begin one"
        ) from error
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise RunDirectoryError(f"{file}: is not the state of a tuning; begin anew with --force") from error
    for key in sorted({*identity, *state.identity}):
        kept, asked = state.identity.get(key), identity.get(key)
        if kept != asked:
            texts = [reprlib.repr(value) for value in (kept, asked)]
            raise RunDirectoryError(
                f"{file}: {key}: kept {texts[0]}, asked for {texts[1]}; ask for the same, or begin anew with "
                "--force"
            )
    return state
