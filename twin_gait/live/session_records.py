"""Record of live sessions: user, time and value of every change, and the run directories.

A session is a file of JSON lines that is only appended to. A thread writes it to the disk as fast as the disk
allows: neither the walk nor a page waits for it, a crash loses at most the last second, and a line that was
truncated by a kill is ignored. A session holds a lock on its file, which the system releases if the process
dies: a session without an end and without a lock was killed.
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
from twin_gait.runs.folders import journal_path, try_lock

FOLDER_VARIABLE = "TWIN_GAIT_SESSIONS"
KILLED, RUNNING = "killed", "going on"
_DETAILS = frozenset({"document", "summary", "tables", "log"})  # keys that a list of sessions omits


class SessionError(TwinGaitError):
    """Error: the record of the sessions cannot be used, or it has no such session."""


def default_records() -> Path:
    """Return the folder of the record: ``$TWIN_GAIT_SESSIONS``, or twin_gait/sessions of the user's data."""
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
    """Recorder of one session, number ``session``; every method except :meth:`close` returns immediately."""

    def __init__(
        self, records: Path, *, user: str, experiment: str, document: Mapping[str, Any], folder: Path
    ) -> None:
        """Begin a session in the record, which is created if it does not exist, readable by this user only.

        ``folder``: run directory that the session will write. Raises SessionError if the record cannot be
        written.
        """
        self.failure = ""  # reason why nothing is recorded any more
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
        """Record an event: an applied or rejected message, or a note."""
        self._put({"log": {**vars(event), "at": _now()}})

    def table(self, document: Mapping[str, Any], tick: int) -> None:
        """Record a version of the gait table and its first tick."""
        self._put({"tables": {"tick": tick, "document": dict(document)}})

    def patient(self, name: str) -> None:
        """Record the name under which the settings of the wearer were saved."""
        self._put({"patient": name})

    def close(self, status: str, tick: int, summary: Mapping[str, Any], folders: Iterable[Path]) -> None:
        """Record status, last tick and summary of the last walk, and wait until they are written."""
        end = {"ended": _now(), "status": status, "tick": tick, "summary": dict(summary)}
        self._put({**end, "folders": list(map(str, folders))})
        self._thread.shutdown()
        with contextlib.suppress(OSError):
            self._file.close()

    def _put(self, entry: Mapping[str, Any]) -> None:
        self._waiting.append(_line(entry))
        self._thread.submit(self._write)

    def _write(self) -> None:
        """Write all pending lines, if there are any."""
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
    """Return the numbers of the sessions that have begun, sorted."""
    paths = [path for path in folder.glob("*.jsonl") if path.stem.isdecimal()]
    return sorted(int(path.stem) for path in paths if path.stat().st_size)


def list_sessions(folder: Path, user: str | None = None, patient: str | None = None) -> list[dict[str, Any]]:
    """Return the sessions of the record, the newest first, as :func:`read_session` but without the details.

    ``user``, ``patient``: names to which the list is restricted, or None. Raises SessionError if the record
    cannot be read.
    """
    if not folder.is_dir():
        raise SessionError(f"{folder}: there is no record of sessions yet; twin-gait live creates it")
    entries = [read_session(folder, number) for number in reversed(_numbers(folder))]
    chosen = [item for item in entries if user in (None, item["user"]) and patient in (None, item["patient"])]
    return [{key: value for key, value in item.items() if key not in _DETAILS} for item in chosen]


def read_session(folder: Path, session: int) -> dict[str, Any]:
    """Read the record of a session.

    Returns ``id``, ``user``, name of the ``patient`` or None, name of the ``experiment``, ``began`` and
    ``ended`` in UTC, ``status`` of the last walk (or ``going on``, or ``killed`` if its process died) and its
    last ``tick``; run directories ``folders`` (before the end also planned ones) and those of them that are
    ``unfinished`` (only their journal exists, which ``twin-gait sessions complete`` converts); numbers of
    applied ``changes``, ``refusals`` and table ``versions``; ``document`` of the experiment, ``summary``,
    ``tables`` and ``log`` with every event in order. Raises SessionError if there is no such session.
    """
    path = _file(folder, session)
    try:
        if (held := try_lock(path)) is not None:
            os.close(held)
        text = read_bytes(path, MOST_TEXT).decode(errors="replace")
    except FileNotFoundError:
        problem = f"there is no session {session}; list all with: twin-gait sessions list"
        raise SessionError(f"{folder}: {problem}") from None
    except OSError as error:
        raise _unusable(path, error) from error
    found: dict[str, Any] = {"id": session, "status": RUNNING if held is None else KILLED}
    found |= {"ended": None, "tick": 0, "summary": {}, "tables": [], "log": []}
    try:
        for line in text.split("\n")[:-1]:
            for key, value in json.loads(line).items():
                if key in ("tables", "log"):
                    found["tick"] = value["tick"]
                    found[key].append(value)
                else:
                    found[key] = value
        left = [item for item in found["folders"] if journal_path(Path(item)).exists()]
        found["unfinished"] = [] if found["status"] == RUNNING else left
        found.setdefault("patient", (found["document"].get("patient") or {}).get("name"))
        responses = [item["response"] for item in found["log"]]
        found |= {"changes": responses.count("applied"), "refusals": responses.count("refused")}
        return found | {"versions": len(found["tables"]), "began": found["began"]}
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise SessionError(f"{path}: is not the record of a session; move it to another folder") from error


def add_folders(folder: Path, first: Path, folders: Iterable[Path]) -> None:
    """Record the run directories that were made from the journal of a session after its end.

    The session is the newest one with the run directory ``first``. Nothing is written if the record has none,
    or if the session is still going on, because it records its directories itself. Raises SessionError if the
    record cannot be used.
    """
    found = (entry for entry in list_sessions(folder) if str(first) in entry["folders"])
    session = next(found, None)
    if session is None or session["status"] == RUNNING:
        return
    path = _file(folder, session["id"])
    try:
        with path.open("r+b") as file:
            file.seek(file.read().rfind(b"\n") + 1)  # overwrite a line that was truncated by a kill
            file.truncate()
            file.write(_line({"folders": list(map(str, folders))}).encode())
    except OSError as error:
        raise _unusable(path, error) from error


def delete_session(folder: Path, session: int) -> None:
    """Delete a session from the record; its run directories stay.

    Raises SessionError if there is no such session, or if it is still going on.
    """
    if read_session(folder, session)["status"] == RUNNING:
        raise SessionError(f"{folder}: session {session} is still running; end it first")
    _file(folder, session).unlink(missing_ok=True)
