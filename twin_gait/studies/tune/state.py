"""Settings, state and result of a tuning.

The state is kept on disk while it runs: one JSON file, replaced after every step, nothing pickled.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from importlib import metadata
from pathlib import Path
from typing import Any, NamedTuple

from twin_gait.configuration.documents import content_hash, experiment_document
from twin_gait.exceptions import ParameterError, RunDirectoryError
from twin_gait.experiment import Experiment
from twin_gait.files import write_atomically
from twin_gait.measures.reference import KILOMETRES_PER_HOUR, reference_covers
from twin_gait.runs.folders import FolderKind, check_target
from twin_gait.simulation import RunStatus
from twin_gait.studies.jobs import sources_hash
from twin_gait.studies.tune.parts import AIM, FALL, HELD_TO, NEEDED_CLEARANCE, WORST, Rating, parts_of
from twin_gait.studies.tune.search import Descent, Generation
from twin_gait.studies.tune.space import Parameter
from twin_gait.studies.tune.walks import NOMINAL_WEIGHT, weighted_cost

STATE_FILE = "state.json"
TUNING = FolderKind("a tuning", STATE_FILE)
SCHEMA_VERSION = 3


@dataclass(frozen=True, kw_only=True)
class Settings:
    """How a table is tuned.

    Attributes:
        reference_speed: Speed of the reference walk in [m] / [s]; None for the belt's.
        minutes: Time for everything; generations under way are finished.
        generations: Of the search; None until the time is over. With a number the result does not depend on
            the machine's speed.
        seed: Of the sensor noise; the search has no chance in it.
        thresholds: Whether angle thresholds count.
        blending: Whether the duration of the blend counts.
        per_side: Whether each leg gets numbers of its own (hemiparesis).
        everyone: Whether the table is for other wearers, supports and belts too, as one that ships is: search
            and robust set then have :func:`twin_gait.studies.tune.cases.corner_cases` in them.
        search_duration: Length of a walk in the search in [s].
        robust_duration: Length of a walk of the robust set in [s].
    """

    reference_speed: float | None = None
    minutes: float = 3.0
    generations: int | None = None
    seed: int = 0
    thresholds: bool = True
    blending: bool = True
    per_side: bool = False
    everyone: bool = False
    search_duration: float = 14.0
    robust_duration: float = 20.0

    def __post_init__(self) -> None:
        """Check the ranges."""
        if not 0.0 < self.minutes < float("inf"):
            raise ParameterError(f"minutes: expected a number above 0, got {self.minutes}")
        if self.generations is not None and self.generations < 1:
            raise ParameterError(f"generations: expected 1 or more, got {self.generations}")
        if self.seed < 0:
            raise ParameterError(f"seed: expected a whole number of 0 or more, got {self.seed}")
        speed = self.reference_speed
        if speed is not None and not reference_covers(speed):
            raise ParameterError(
                f"reference: Koopman's curves cover 0.5 to 5 km/h, got {speed * KILOMETRES_PER_HOUR:g}"
            )


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
    """How far a tuning has come.

    Attributes:
        identity: What makes it this one: experiment, seed, settings, versions.
        elapsed: Time that it has taken over all calls in [s].
        start_cost: Cost of the table that is to be bettered, or None.
        generations: Of the search.
        descent: Where it stands, or None before it.
    """

    identity: dict[str, Any]
    elapsed: float = 0.0
    start_cost: float | None = None
    generations: list[Generation] = field(default_factory=list)
    descent: Descent | None = None


class Progress(NamedTuple):
    """Where a tuning stands.

    Attributes:
        stage: ``compiling``, ``search``, ``robust set`` or ``departures``.
        done: Of this stage: walks, or generations.
        total: In all, or None while only the time ends it.
        elapsed: In [s].
        start_cost: Of the table that it began with.
        best_cost: Of the best candidate so far.
        best_values: Parts of its nominal walk; empty if it was found before the tuning was resumed.
    """

    stage: str
    done: int
    total: int | None
    elapsed: float
    start_cost: float
    best_cost: float
    best_values: Mapping[str, float | None]


@dataclass(frozen=True, eq=False)
class Finalist:
    """A table that walked the robust set.

    Attributes:
        table: Its document.
        points: Coordinates of what was searched for; None for the table that it began with.
        search_cost: In the search.
        walks: Name of the case and result, nominal first.
    """

    table: dict[str, Any]
    points: tuple[float, ...] | None
    search_cost: float
    walks: tuple[tuple[str, Rating], ...]

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
    """Result of a tuning.

    Attributes:
        status: ``COMPLETED``, or ``INTERRUPTED``: then only the state is kept.
        parameters: All numbers that were searched for.
        state: With all generations.
        before: The table that was to be bettered.
        ranked: All finalists, the best first; ``before`` is one of them.
        began_with: Name of the table that the search began with, see :func:`start_tables`.
    """

    status: RunStatus
    parameters: tuple[Parameter, ...]
    state: State
    before: Finalist | None
    ranked: tuple[Finalist, ...]
    began_with: str


def open_state(directory: Path, identity: Mapping[str, Any], *, resume: bool, force: bool) -> State:
    """Begin a tuning's folder, or read how far it has come.

    Raises:
        RunDirectoryError: If the folder may not be used, or holds another tuning.
    """
    plain = json.loads(json.dumps(identity))
    file = directory / STATE_FILE
    if resume and not force:
        return _read(file, plain)
    _check_place(directory, force=force)
    try:
        if directory.exists():
            shutil.rmtree(directory)
        directory.mkdir(parents=True)
    except OSError as error:
        raise RunDirectoryError(
            f"{directory}: cannot be written ({error.strerror}); choose another --out"
        ) from error
    return State(plain)


def _check_place(directory: Path, *, force: bool) -> None:
    """Refuse a folder that holds something, unless it is a tuning that may be replaced."""
    if not directory.exists() or (directory.is_dir() and not any(directory.iterdir())):
        return
    if not force:
        raise RunDirectoryError(
            f"{directory}: exists; go on with --resume, replace it with --force, or choose another --out"
        )
    check_target(directory, TUNING, force=True)


def write_state(state: State, directory: Path) -> None:
    """Keep the state."""
    document = {
        "schema_version": SCHEMA_VERSION,
        "identity": state.identity,
        "elapsed_s": state.elapsed,
        "start_cost": state.start_cost,
        "generations": [generation._asdict() for generation in state.generations],
        "descent": None if state.descent is None else asdict(state.descent),
    }
    write_atomically(directory / STATE_FILE, json.dumps(document, indent=1, allow_nan=False) + "\n")


def _read(file: Path, identity: dict[str, Any]) -> State:
    try:
        document = json.loads(file.read_text(encoding="utf-8"))
        state = State(
            document["identity"],
            float(document["elapsed_s"]),
            document["start_cost"],
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
            raise RunDirectoryError(
                f"{file}: {key}: kept {_short(kept)}, asked for {_short(asked)}; ask for the same, "
                "or begin anew with --force"
            )
    return state


def _short(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
