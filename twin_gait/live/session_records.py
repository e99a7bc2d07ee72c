"""The record of live sessions: who changed what, when, and where the run is.

A session is a file of JSON lines that is only ever appended to, by a thread that puts it on the disk as fast
as the disk goes: neither the walk nor a page waits for it, a crash loses at most the last second, and a line
that a kill has cut short is left out. A session holds a lock on its file, which the system takes back from
the dead: no end and no lock means killed.
"""

import contextlib
import fcntl
import itertools
import json
import os
from collections import deque
from collections.abc import Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from twin_gait.exceptions import RunDirectoryError, TwinGaitError
from twin_gait.files import MOST_TEXT, private_files, read_bytes, write_new
from twin_gait.live.protocol import Event
from twin_gait.runs.folders import hold, journal_of

FOLDER_VARIABLE = "TWIN_GAIT_SESSIONS"
KILLED, GOING_ON = "killed", "going on"
_DETAILS = frozenset({"document", "summary", "tables", "log"})  # that a list of sessions leaves out


class SessionError(TwinGaitError):
    """The record of the sessions cannot be used, or has no such session."""


def default_records() -> Path:
    """Folder of the record: ``$TWIN_GAIT_SESSIONS``, or twin_gait/sessions in the user's data folder."""
    chosen = os.environ.get(FOLDER_VARIABLE)
    if chosen:
        return Path(chosen).expanduser()
    base = os.environ.get("XDG_DATA_HOME") or str(Path.home() / ".local" / "share")
    return Path(base) / "twin_gait" / "sessions"


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="milliseconds")


def _unusable(path: Path, error: Exception) -> SessionError:
    reason = getattr(error, "strerror", error)
    return SessionError(f"{path}: cannot be used ({reason}); set {FOLDER_VARIABLE}")


class SessionRecorder:
    """Records one session, number ``session``; every method but :meth:`close` returns at once."""

    def __init__(
        self, records: Path, *, user: str, experiment: str, document: Mapping[str, Any], folder: Path
    ) -> None:
        """Begin a session in the record, which is made if there is none; nobody else may read it.

        ``folder``: run folder to come. Raises SessionError if the record cannot be written.
        """
        self.failure = ""  # why nothing is recorded any more
        self._waiting: deque[str] = deque()
        self._thread = ThreadPoolExecutor(1, "session recorder")
        began = {"user": user, "experiment": experiment, "document": dict(document), "began": _now()}
        line = _line({**began, "folders": [str(folder)]})
        try:
            with private_files():
                records.mkdir(parents=True, exist_ok=True)
                numbers = itertools.count(max(_numbers(records), default=0) + 1)
                path = write_new((_file(records, number) for number in numbers), line)
                self._file = path.open("a", encoding="utf-8")
            fcntl.flock(self._file, fcntl.LOCK_EX)
        except (OSError, RunDirectoryError) as error:
            raise _unusable(records, error) from error
        self.session = int(path.stem)

    def event(self, event: Event) -> None:
        """Record an event: what was applied or refused, or a note."""
        self._put({"log": {**vars(event), "at": _now()}})

    def table(self, document: Mapping[str, Any], tick: int) -> None:
        """Record a version of the gait table and its first tick."""
        self._put({"tables": {"tick": tick, "document": dict(document)}})

    def close(self, status: str, tick: int, summary: Mapping[str, Any], folders: Iterable[Path]) -> None:
        """Record how and in which tick the last walk ended, with its summary; wait until it is written."""
        end = {"ended": _now(), "status": status, "tick": tick, "summary": dict(summary)}
        self._put({**end, "folders": list(map(str, folders))})
        self._thread.shutdown()
        with contextlib.suppress(OSError):
            self._file.close()

    def _put(self, entry: Mapping[str, Any]) -> None:
        self._waiting.append(_line(entry))
        self._thread.submit(self._write)

    def _write(self) -> None:
        """Write all that waits, which may be nothing by now."""
        try:
            self._file.write("".join(self._waiting.popleft() for _ in range(len(self._waiting))))
            self._file.flush()
            os.fsync(self._file.fileno())
        except OSError as error:
            self.failure = error.strerror or str(error)


def _line(entry: Mapping[str, Any]) -> str:
    return json.dumps(entry, ensure_ascii=False) + "\n"


def _file(folder: Path, session: int) -> Path:
    return folder / f"{session}.jsonl"


def _numbers(folder: Path) -> list[int]:
    """Of the sessions that have begun."""
    paths = [path for path in folder.glob("*.jsonl") if path.stem.isdecimal()]
    return sorted(int(path.stem) for path in paths if path.stat().st_size)


def list_sessions(folder: Path, user: str | None = None) -> list[dict[str, Any]]:
    """All sessions of the record, the newest first: what :func:`read_session` gives, without the details.

    Raises SessionError if the record cannot be read.
    """
    if not folder.is_dir():
        raise SessionError(f"{folder}: there is no record of sessions yet; twin-gait live makes one")
    entries = [read_session(folder, number) for number in reversed(_numbers(folder))]
    chosen = [item for item in entries if user is None or item["user"] == user]
    return [{key: value for key, value in item.items() if key not in _DETAILS} for item in chosen]


def read_session(folder: Path, session: int) -> dict[str, Any]:
    """Everything that is recorded of a session.

    Returns ``id``, ``user``, name of the ``experiment``, ``began`` and ``ended`` in UTC, ``status`` of the
    last walk (or ``going on``, or ``killed`` if nobody is there to end it) and its last ``tick``, run
    ``folders`` (without an end also those to come), those of them that are ``unfinished`` (only their
    journal exists, of which ``twin-gait sessions complete`` makes them), how many ``changes`` were applied,
    ``refusals`` and ``versions`` of the table there were; ``document`` of the experiment, ``summary``,
    ``tables`` and ``log``: every event in order. Raises SessionError if there is no such session.
    """
    path = _file(folder, session)
    try:
        if (held := hold(path)) is not None:
            os.close(held)
        text = read_bytes(path, MOST_TEXT).decode(errors="replace")
    except FileNotFoundError:
        raise SessionError(f"{folder}: no session {session}; twin-gait sessions list shows all") from None
    except OSError as error:
        raise _unusable(path, error) from error
    found: dict[str, Any] = {"id": session, "status": GOING_ON if held is None else KILLED}
    found |= {"ended": None, "tick": 0, "summary": {}, "tables": [], "log": []}
    try:
        for line in text.split("\n")[:-1]:
            for key, value in json.loads(line).items():
                if key in ("tables", "log"):
                    found["tick"] = value["tick"]
                    found[key].append(value)
                else:
                    found[key] = value
        left = [item for item in found["folders"] if journal_of(Path(item)).exists()]
        found["unfinished"] = [] if found["status"] == GOING_ON else left
        responses = [item["response"] for item in found["log"]]
        found |= {"changes": responses.count("applied"), "refusals": responses.count("refused")}
        return found | {"versions": len(found["tables"]), "began": found["began"]}
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise SessionError(f"{path}: is not the record of a session; move it away") from error


def add_folders(folder: Path, first: Path, folders: Iterable[Path]) -> None:
    """Record the run folders that were made of the journal of a session after its end.

    The session is the newest one with the run folder ``first``. Nothing is written if the record has none,
    or if the session is going on: it records its folders itself. Raises SessionError if the record cannot be
    used.
    """
    found = (entry for entry in list_sessions(folder) if str(first) in entry["folders"])
    session = next(found, None)
    if session is None or session["status"] == GOING_ON:
        return
    path = _file(folder, session["id"])
    try:
        with path.open("r+b") as file:
            file.seek(file.read().rfind(b"\n") + 1)  # over a line that a kill has cut short
            file.truncate()
            file.write(_line({"folders": list(map(str, folders))}).encode())
    except OSError as error:
        raise _unusable(path, error) from error


def delete_session(folder: Path, session: int) -> None:
    """Take a session out of the record; its run folders stay.

    Raises SessionError if there is no such session, or it is still going on.
    """
    if read_session(folder, session)["status"] == GOING_ON:
        raise SessionError(f"{folder}: session {session} is going on; end it first")
    _file(folder, session).unlink(missing_ok=True)
