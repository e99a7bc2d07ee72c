"""What a tuning keeps on disk while it runs: one JSON file, replaced after every step, nothing pickled."""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from twin_gait.exceptions import RunDirectoryError
from twin_gait.files import write_atomically
from twin_gait.runs.folders import FolderKind, check_target
from twin_gait.studies.tune.search import Generation

STATE_FILE = "state.json"
TUNING = FolderKind("a tuning", STATE_FILE)
SCHEMA_VERSION = 1


@dataclass
class State:
    """How far a tuning has come.

    Attributes:
        identity: What makes it this one: experiment, seed, settings, versions.
        elapsed: Time that it has taken over all calls in [s].
        start_cost: Cost of the table that is to be bettered, or None.
        screening: Costs of the screening's points so far, in their order.
        generations: Of the search.
    """

    identity: dict[str, Any]
    elapsed: float = 0.0
    start_cost: float | None = None
    screening: list[float] = field(default_factory=list)
    generations: list[Generation] = field(default_factory=list)


def open_state(directory: Path, identity: Mapping[str, Any], *, resume: bool, force: bool) -> State:
    """Begin a tuning's folder, or read how far it has come.

    Args:
        directory: The folder.
        identity: What makes it this one, plain values.
        resume: Whether to go on with what is there.
        force: Whether an earlier tuning may be replaced.

    Returns:
        The state.

    Raises:
        RunDirectoryError: If the folder may not be used, or holds another tuning.
    """
    plain = json.loads(json.dumps(identity))
    file = directory / STATE_FILE
    if resume and not force:
        return _read(file, plain)
    check_place(directory, force=force)
    try:
        if directory.exists():
            shutil.rmtree(directory)
        directory.mkdir(parents=True)
    except OSError as error:
        raise RunDirectoryError(
            f"{directory}: cannot be written ({error.strerror}); choose another --out"
        ) from error
    return State(plain)


def check_place(directory: Path, *, force: bool) -> None:
    """Refuse a folder that holds something, unless it is a tuning that may be replaced.

    Raises:
        RunDirectoryError: If it may not be used.
    """
    if not directory.exists() or (directory.is_dir() and not any(directory.iterdir())):
        return
    if not force:
        raise RunDirectoryError(
            f"{directory}: exists; go on with --resume, replace it with --force, or choose another --out"
        )
    check_target(directory, TUNING, force=True)


def write_state(state: State, directory: Path) -> None:
    """Keep the state.

    Raises:
        RunDirectoryError: If it cannot be written.
    """
    document = {
        "schema_version": SCHEMA_VERSION,
        "identity": state.identity,
        "elapsed_s": state.elapsed,
        "start_cost": state.start_cost,
        "screening": state.screening,
        "generations": [generation._asdict() for generation in state.generations],
    }
    write_atomically(directory / STATE_FILE, json.dumps(document, indent=1, allow_nan=False) + "\n")


def _read(file: Path, identity: dict[str, Any]) -> State:
    try:
        document = json.loads(file.read_text(encoding="utf-8"))
        state = State(
            document["identity"],
            float(document["elapsed_s"]),
            document["start_cost"],
            [float(cost) for cost in document["screening"]],
            [Generation(item["points"], item["costs"]) for item in document["generations"]],
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
