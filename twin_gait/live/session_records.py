"""The record of live sessions, kept in SQLite: who changed what, when, and where the run is.

A session is written by a thread of its own, twice a second or more, so that neither the walk nor a page waits
for the disk and a crash loses at most the last second. The write-ahead log of SQLite keeps the file whole
however a process ends.
"""

from __future__ import annotations

import hashlib
import json
import os
import sqlite3
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Protocol

from twin_gait.exceptions import TwinGaitError

SCHEMA_VERSION = 1
DATABASE_VARIABLE = "TWIN_GAIT_SESSIONS"
WRITE_EVERY = 0.25  # [s]; a crash loses what came after the last write
KILLED = "killed"
STALE = 5.0  # [s]; a session that has not been heard of for so long and has no end was killed
BUSY_TIME = 10.0  # [s] to wait for another process that writes

_SCHEMA = """
CREATE TABLE sessions (
    id INTEGER PRIMARY KEY,
    user TEXT NOT NULL,
    experiment TEXT NOT NULL,
    document TEXT NOT NULL,
    began TEXT NOT NULL,
    heard REAL NOT NULL,
    ended TEXT,
    status TEXT NOT NULL,
    tick INTEGER NOT NULL,
    folders TEXT NOT NULL,
    summary TEXT NOT NULL
);
CREATE TABLE tables (
    session INTEGER NOT NULL REFERENCES sessions (id) ON DELETE CASCADE,
    version INTEGER NOT NULL,
    tick INTEGER NOT NULL,
    sha256 TEXT NOT NULL,
    document TEXT NOT NULL,
    PRIMARY KEY (session, version)
);
CREATE TABLE changes (
    session INTEGER NOT NULL REFERENCES sessions (id) ON DELETE CASCADE,
    serial INTEGER NOT NULL,
    at TEXT NOT NULL,
    tick INTEGER NOT NULL,
    outcome TEXT NOT NULL,
    user TEXT NOT NULL,
    subject TEXT NOT NULL,
    before TEXT NOT NULL,
    value TEXT NOT NULL,
    text TEXT NOT NULL,
    PRIMARY KEY (session, serial)
);
"""


class SessionError(TwinGaitError):
    """The record of the sessions cannot be used, or has no such session."""


class Change(Protocol):
    """What is recorded of an event; :class:`twin_gait.live.protocol.Event` is one."""

    @property
    def serial(self) -> int:
        """Number of the event in its session."""

    @property
    def tick(self) -> int:
        """First tick with the change."""

    @property
    def outcome(self) -> str:
        """Applied, refused or a note."""

    @property
    def user(self) -> str:
        """Who."""

    @property
    def subject(self) -> str:
        """Control or action."""

    @property
    def before(self) -> Any:
        """Value before."""

    @property
    def value(self) -> Any:
        """Value after."""

    @property
    def text(self) -> str:
        """One sentence."""


def default_database() -> Path:
    """File of the record: ``$TWIN_GAIT_SESSIONS``, or twin_gait/sessions.sqlite in the user's data folder."""
    chosen = os.environ.get(DATABASE_VARIABLE)
    if chosen:
        return Path(chosen).expanduser()
    base = os.environ.get("XDG_DATA_HOME") or str(Path.home() / ".local" / "share")
    return Path(base) / "twin_gait" / "sessions.sqlite"


# ---------------------------------------------------------------------- opening


@contextmanager
def _opened(path: Path, *, make: bool = False) -> Iterator[sqlite3.Connection]:
    """A connection; a mistake of the file ends in one line."""
    try:
        if make:
            path.parent.mkdir(parents=True, exist_ok=True)
            _keep_private(path)
        elif not path.is_file():
            raise SessionError(f"{path}: there is no record of sessions yet; twin-gait live makes one")
        with closing(sqlite3.connect(path, timeout=BUSY_TIME, isolation_level=None)) as database:
            _prepare(database, path)
            yield database
    except sqlite3.Error as error:
        raise SessionError(
            f"{path}: cannot be used ({error}); move it away, or set {DATABASE_VARIABLE}"
        ) from error
    except OSError as error:
        raise SessionError(
            f"{path}: cannot be written ({error.strerror}); set {DATABASE_VARIABLE}"
        ) from error


def _keep_private(path: Path) -> None:
    """Make the file for its owner alone, and one of an earlier version so; SQLite's own follow it."""
    os.close(os.open(path, os.O_RDWR | os.O_CREAT, 0o600))
    if path.stat().st_uid == os.geteuid():
        path.chmod(0o600)


def _prepare(database: sqlite3.Connection, path: Path) -> None:
    database.execute("PRAGMA journal_mode = WAL")
    database.execute("PRAGMA synchronous = FULL")  # a commit is on the disk, even if the power fails
    database.execute("PRAGMA foreign_keys = ON")
    version = database.execute("PRAGMA user_version").fetchone()[0]
    if version == 0:
        _make(database)
    elif version != SCHEMA_VERSION:
        raise SessionError(
            f"{path}: has version {version} of the record, expected {SCHEMA_VERSION}; move it away"
        )


def _make(database: sqlite3.Connection) -> None:
    with _transaction(database):
        if database.execute("PRAGMA user_version").fetchone()[0] == 0:
            for statement in _SCHEMA.strip().rstrip(";").split(";\n"):
                database.execute(statement)
            database.execute(f"PRAGMA user_version = {SCHEMA_VERSION}")


@contextmanager
def _transaction(database: sqlite3.Connection) -> Iterator[None]:
    database.execute("BEGIN IMMEDIATE")
    try:
        yield
    except BaseException:
        database.execute("ROLLBACK")
        raise
    database.execute("COMMIT")


# ---------------------------------------------------------------------- recording


Write = Callable[[sqlite3.Connection], object]


class SessionRecorder:
    """Records one session; every method but :meth:`close` returns at once.

    Attributes:
        session: Number of the session in the record.
        failure: Why nothing is recorded any more, or empty.
    """

    def __init__(self, path: Path, *, user: str, experiment: str, document: Mapping[str, Any]) -> None:
        """Begin a session in the record, which is made if there is none.

        Args:
            path: Of the record.
            user: Who.
            experiment: Name of the preset or file.
            document: Mapping of the experiment, everything resolved.

        Raises:
            SessionError: If the record cannot be written.
        """
        self.failure = ""
        self._path = path
        with _opened(path, make=True) as database, _transaction(database):
            row = database.execute(
                "INSERT INTO sessions"
                " (user, experiment, document, began, heard, status, tick, folders, summary)"
                " VALUES (?, ?, ?, ?, ?, 'starting', 0, '[]', '{}')",
                (user, experiment, json.dumps(document), _now(), time.time()),
            )
            self.session = int(row.lastrowid or 0)
        self._tables: list[str] = []
        self._waiting: list[Write] = []
        self._progress: tuple[int, str] = (0, "starting")
        self._lock, self._closed = threading.Lock(), threading.Event()
        self._thread = threading.Thread(target=self._write, name="session recorder", daemon=True)
        self._thread.start()

    def event(self, event: Change) -> None:
        """Record what became of a message, or a note.

        Args:
            event: The event.
        """
        row = (
            self.session,
            event.serial,
            _now(),
            event.tick,
            str(event.outcome),
            event.user,
            event.subject,
            json.dumps(event.before),
            json.dumps(event.value),
            event.text,
        )
        self._put(lambda database: database.execute(f"INSERT INTO changes VALUES ({_places(row)})", row))

    def table(self, document: Mapping[str, Any], tick: int) -> None:
        """Record a version of the gait table; one that is as the last is no new version.

        Args:
            document: Mapping of the table's file.
            tick: First tick with it.
        """
        text = json.dumps(document)
        sha256 = hashlib.sha256(text.encode()).hexdigest()
        if self._tables and self._tables[-1] == sha256:
            return
        self._tables.append(sha256)
        row = (self.session, len(self._tables), tick, sha256, text)
        self._put(lambda database: database.execute(f"INSERT INTO tables VALUES ({_places(row)})", row))

    def progress(self, tick: int, status: str) -> None:
        """Note how far the walk is; written with the next changes.

        Args:
            tick: Present tick.
            status: What the walk does.
        """
        self._progress = (tick, status)

    def folders(self, folders: Sequence[str]) -> None:
        """Record the run folders.

        Args:
            folders: All so far.
        """
        row = (json.dumps(list(folders)), self.session)
        self._put(lambda database: database.execute("UPDATE sessions SET folders = ? WHERE id = ?", row))

    def close(self, status: str, summary: Mapping[str, Any], folders: Sequence[str]) -> None:
        """Record the end of the session and wait until it is written.

        Args:
            status: How the last walk ended.
            summary: Of the last walk.
            folders: Run folders.
        """
        row = (_now(), json.dumps(dict(summary)), json.dumps(list(folders)), self.session)
        self._progress = (self._progress[0], status)
        self._put(
            lambda database: database.execute(
                "UPDATE sessions SET ended = ?, summary = ?, folders = ? WHERE id = ?", row
            )
        )
        self._closed.set()
        self._thread.join()

    def _put(self, write: Write) -> None:
        with self._lock:
            self._waiting.append(write)

    def _write(self) -> None:
        try:
            with _opened(self._path) as database:
                closing_down = False
                while not closing_down:
                    closing_down = self._closed.wait(WRITE_EVERY)
                    self._write_waiting(database)
        except SessionError as error:
            self.failure = str(error)

    def _write_waiting(self, database: sqlite3.Connection) -> None:
        with self._lock:
            waiting, self._waiting = self._waiting, []
        tick, status = self._progress
        with _transaction(database):
            for write in waiting:
                write(database)
            database.execute(
                "UPDATE sessions SET heard = ?, tick = ?, status = ? WHERE id = ?",
                (time.time(), tick, status, self.session),
            )


def _places(row: Sequence[object]) -> str:
    return ", ".join("?" * len(row))


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="milliseconds")


# ---------------------------------------------------------------------- reading


@dataclass(frozen=True, kw_only=True)
class SessionEntry:
    """One session of the record.

    Attributes:
        id: Number.
        user: Who.
        experiment: Name of the preset or file.
        began: When, in UTC.
        ended: When, in UTC, or None.
        status: What the walk did last; ``killed`` if the session has no end and is not heard of.
        tick: Last tick known of the last walk.
        folders: Run folders; of a session without an end also those to come.
        changes: How many changes were applied.
        refusals: How many were refused.
        versions: Versions of the gait table.
    """

    id: int
    user: str
    experiment: str
    began: str
    ended: str | None
    status: str
    tick: int
    folders: tuple[str, ...]
    changes: int
    refusals: int
    versions: int


_ENTRIES = """
SELECT id, user, experiment, began, ended, status, tick, folders, heard,
    (SELECT COUNT(*) FROM changes WHERE session = id AND outcome = 'applied'),
    (SELECT COUNT(*) FROM changes WHERE session = id AND outcome = 'refused'),
    (SELECT COUNT(*) FROM tables WHERE session = id)
FROM sessions
"""


def list_sessions(path: Path, user: str | None = None) -> list[SessionEntry]:
    """All sessions of the record, the newest first.

    Args:
        path: Of the record.
        user: Only those of this user.

    Returns:
        The sessions.

    Raises:
        SessionError: If the record cannot be read.
    """
    with _opened(path) as database:
        rows = database.execute(f"{_ENTRIES} ORDER BY id DESC").fetchall()
    entries = [_entry(row) for row in rows]
    return [item for item in entries if user is None or item.user == user]


def _entry(row: Sequence[Any]) -> SessionEntry:
    number, user, experiment, began, ended, status, tick, folders, heard, changes, refusals, versions = row
    lost = ended is None and time.time() - heard > STALE
    return SessionEntry(
        id=number,
        user=user,
        experiment=experiment,
        began=began,
        ended=ended,
        status=KILLED if lost else status,
        tick=tick,
        folders=tuple(json.loads(folders)),
        changes=changes,
        refusals=refusals,
        versions=versions,
    )


def read_session(path: Path, session: int) -> dict[str, Any]:
    """Everything that is recorded of a session.

    Args:
        path: Of the record.
        session: Number.

    Returns:
        The entry's fields, ``document`` of the experiment, ``summary``, ``tables`` and ``log``: every event
        in order.

    Raises:
        SessionError: If there is no such session.
    """
    with _opened(path) as database:
        row = database.execute(f"{_ENTRIES} WHERE id = ?", (session,)).fetchone()
        if row is None:
            raise _no_session(path, session, database)
        texts = database.execute("SELECT document, summary FROM sessions WHERE id = ?", (session,)).fetchone()
        tables = database.execute(
            "SELECT version, tick, sha256, document FROM tables WHERE session = ? ORDER BY version",
            (session,),
        ).fetchall()
        log = database.execute(
            "SELECT serial, at, tick, outcome, user, subject, before, value, text FROM changes"
            " WHERE session = ? ORDER BY serial",
            (session,),
        ).fetchall()
    entry = _entry(row)
    return {
        **{name: getattr(entry, name) for name in entry.__dataclass_fields__},
        "folders": list(entry.folders),
        "document": json.loads(texts[0]),
        "summary": json.loads(texts[1]),
        "tables": [
            {"version": version, "tick": tick, "sha256": sha256, "document": json.loads(text)}
            for version, tick, sha256, text in tables
        ],
        "log": [_logged(item) for item in log],
    }


_LOG_COLUMNS = ("serial", "at", "tick", "outcome", "user", "subject", "before", "value", "text")


def _logged(row: Sequence[Any]) -> dict[str, Any]:
    found = dict(zip(_LOG_COLUMNS, row, strict=True))
    return {**found, "before": json.loads(found["before"]), "value": json.loads(found["value"])}


def _no_session(path: Path, session: int, database: sqlite3.Connection) -> SessionError:
    known = [str(row[0]) for row in database.execute("SELECT id FROM sessions ORDER BY id DESC LIMIT 10")]
    there = f"the newest are {', '.join(known)}" if known else "it is empty"
    return SessionError(f"{path}: no session {session}; {there}")


def close_killed(
    path: Path,
    session: int,
    *,
    tick: int,
    text: str,
    summary: Mapping[str, Any],
    folders: Sequence[str],
) -> None:
    """Record how a session ended whose own processes no longer could.

    Args:
        path: Of the record.
        session: Number.
        tick: Ticks that are kept of the last walk.
        text: What happened, in one sentence; becomes the last entry of the session's log.
        summary: Of the last walk.
        folders: Run folders.

    Raises:
        SessionError: If the record cannot be written.
    """
    with _opened(path) as database, _transaction(database):
        last = database.execute("SELECT MAX(serial) FROM changes WHERE session = ?", (session,)).fetchone()[0]
        row = (session, (last or 0) + 1, _now(), tick, "note", "", "", "null", "null", text)
        database.execute(f"INSERT INTO changes VALUES ({_places(row)})", row)
        database.execute(
            "UPDATE sessions SET ended = ?, status = ?, tick = ?, summary = ?, folders = ? WHERE id = ?",
            (_now(), KILLED, tick, json.dumps(dict(summary)), json.dumps(list(folders)), session),
        )


def delete_session(path: Path, session: int) -> None:
    """Take a session out of the record; its run folders stay.

    Args:
        path: Of the record.
        session: Number.

    Raises:
        SessionError: If there is no such session, or it is still going on.
    """
    with _opened(path) as database, _transaction(database):
        row = database.execute("SELECT ended, heard FROM sessions WHERE id = ?", (session,)).fetchone()
        if row is None:
            raise _no_session(path, session, database)
        if row[0] is None and time.time() - row[1] <= STALE:
            raise SessionError(f"{path}: session {session} is going on; end it first")
        database.execute("DELETE FROM sessions WHERE id = ?", (session,))
