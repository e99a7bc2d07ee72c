"""The record of live sessions: who changed what, when, and where the run is.

A session is a file of JSON lines that is only ever appended to, by a thread that puts it on the disk as fast
as the disk goes: neither the walk nor a page waits for it, a crash loses at most the last second, and a line
that a kill has cut short is left out. A session holds a lock on its file, which the system takes back from
the dead: no end and no lock means killed.
"""

import contextlib
import fcntl
import json
import os
from collections import deque
from collections.abc import Iterable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from twin_gait.exceptions import TwinGaitError
from twin_gait.live.protocol import Event
from twin_gait.runs.folders import hold

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


def _unusable(path: Path, error: OSError) -> SessionError:
    return SessionError(f"{path}: cannot be used ({error.strerror}); set {FOLDER_VARIABLE}")


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
        try:
            records.mkdir(parents=True, exist_ok=True, mode=0o700)
            self.session, self._descriptor = _make(records)
        except OSError as error:
            raise _unusable(records, error) from error
        began = {"user": user, "experiment": experiment, "document": dict(document), "began": _now()}
        self._put({**began, "folders": [str(folder)]}).result()  # before anybody lists the session

    def event(self, event: Event) -> None:
        """Record an event: what was applied or refused, or a note."""
        self._put({"event": {**vars(event), "at": _now()}})

    def table(self, document: Mapping[str, Any], tick: int) -> None:
        """Record a version of the gait table and its first tick."""
        self._put({"table": {"tick": tick, "document": dict(document)}})

    def close(self, status: str, tick: int, summary: Mapping[str, Any], folders: Iterable[Path]) -> None:
        """Record how and in which tick the last walk ended, with its summary; wait until it is written."""
        end = {"ended": _now(), "status": status, "tick": tick, "summary": dict(summary)}
        self._put({"end": {**end, "folders": list(map(str, folders))}})
        self._thread.shutdown()
        os.close(self._descriptor)

    def _put(self, entry: Mapping[str, Any]) -> Future[None]:
        self._waiting.append(json.dumps(entry, ensure_ascii=False) + "\n")
        return self._thread.submit(self._write)

    def _write(self) -> None:
        """Write all that waits, which may be nothing by now."""
        rest = memoryview("".join(self._waiting.popleft() for _ in range(len(self._waiting))).encode())
        try:
            while rest:
                rest = rest[os.write(self._descriptor, rest) :]
            os.fsync(self._descriptor)
        except OSError as error:
            self.failure = error.strerror or str(error)


def _make(folder: Path) -> tuple[int, int]:
    """File of a new session, locked: its number and descriptor."""
    number = max(_numbers(folder), default=0)
    while True:  # another session may begin in this moment
        number += 1
        with contextlib.suppress(FileExistsError):
            flags = os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_EXCL
            descriptor = os.open(_file(folder, number), flags, 0o600)
            fcntl.flock(descriptor, fcntl.LOCK_EX)
            return number, descriptor


def _file(folder: Path, session: int) -> Path:
    return folder / f"{session}.jsonl"


def _numbers(folder: Path) -> list[int]:
    return sorted(int(path.stem) for path in folder.glob("*.jsonl") if path.stem.isdecimal())


def list_sessions(folder: Path, user: str | None = None) -> list[dict[str, Any]]:
    """All sessions of the record, the newest first: what :func:`read_session` gives, without the details.

    Raises SessionError if the record cannot be read.
    """
    if not folder.is_dir():
        raise SessionError(f"{folder}: there is no record of sessions yet; twin-gait live makes one")
    entries = [read_session(folder, number) for number in reversed(_numbers(folder))]
    return [
        {key: value for key, value in item.items() if key not in _DETAILS}
        for item in entries
        if user is None or item["user"] == user
    ]


def read_session(folder: Path, session: int) -> dict[str, Any]:
    """Everything that is recorded of a session.

    Returns ``id``, ``user``, name of the ``experiment``, ``began`` and ``ended`` in UTC, ``status`` of the
    last walk (or ``going on``, or ``killed`` if nobody is there to end it) and its last ``tick``, run
    ``folders`` (without an end also those to come), how many ``changes`` were applied, ``refusals`` and
    ``versions`` of the table there were; ``document`` of the experiment, ``summary``, ``tables`` and ``log``:
    every event in order. Raises SessionError if there is no such session.
    """
    path = _file(folder, session)
    try:
        if (held := hold(path)) is not None:
            os.close(held)
        text = path.read_bytes().decode(errors="replace")
    except FileNotFoundError:
        text = f"{folder}: no session {session}; twin-gait sessions list shows all"
        raise SessionError(text) from None
    except OSError as error:
        raise _unusable(path, error) from error
    try:
        entries = [json.loads(line) for line in text[: text.rfind("\n") + 1].splitlines()]
        empty = {"user": "", "experiment": "", "document": {}, "began": _now(), "folders": []}
        first: dict[str, Any] = empty if not entries or "event" in entries[0] else entries[0]
        of = {kind: [item[kind] for item in entries if kind in item] for kind in ("event", "table", "end")}
        log, tables, end = of["event"], of["table"], (of["end"] or [{}])[0]
        responses = [item["response"] for item in log]
        return {
            "id": session,
            **{key: first[key] for key in empty},
            "ended": end.get("ended"),
            "status": end.get("status") or (GOING_ON if held is None else KILLED),
            "tick": end.get("tick") or max((item["tick"] for item in (*log, *tables)), default=0),
            "folders": end.get("folders", first["folders"]),
            "changes": responses.count("applied"),
            "refusals": responses.count("refused"),
            "versions": len(tables),
            "summary": end.get("summary", {}),
            "tables": tables,
            "log": log,
        }
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise SessionError(f"{path}: is not the record of a session; move it away") from error


def delete_session(folder: Path, session: int) -> None:
    """Take a session out of the record; its run folders stay.

    Raises SessionError if there is no such session, or it is still going on.
    """
    if read_session(folder, session)["status"] == GOING_ON:
        raise SessionError(f"{folder}: session {session} is going on; end it first")
    _file(folder, session).unlink(missing_ok=True)
