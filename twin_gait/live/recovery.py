"""Sessions whose processes were killed: their walks are completed, and the record says what happened."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from twin_gait.exceptions import RunDirectoryError
from twin_gait.gait.table import TICK
from twin_gait.live.finishing import Completed, complete
from twin_gait.live.session_records import KILLED, SessionEntry, close_killed, list_sessions
from twin_gait.runs.folders import journal_of
from twin_gait.runs.record import SUMMARY_FILE


def recover(records: Path) -> Iterator[str]:
    """Complete the run folders of all sessions that were killed, and close those sessions in the record.

    Yields:
        One sentence for each session, as the record has it from then on.

    Raises:
        SessionError: If the record cannot be used.
    """
    for entry in list_sessions(records):
        if entry.status == KILLED and entry.ended is None:
            try:
                yield f"session {entry.id}: {_recover(records, entry)}"
            except RunDirectoryError as error:  # it may be going on after all: its journal is held
                yield f"session {entry.id} cannot be completed: {error}"


def _recover(records: Path, entry: SessionEntry) -> str:
    folders = []
    for folder in map(Path, entry.folders):
        done: Completed | None = complete(journal_of(folder)) if journal_of(folder).exists() else None
        folders.append(folder if done is None else done.folder)
    there = [str(folder) for folder in folders if (folder / SUMMARY_FILE).is_file()]
    summary: dict[str, Any] = {}
    if there:
        summary = json.loads((Path(there[-1]) / SUMMARY_FILE).read_text(encoding="utf-8"))
    tick = round(summary.get("duration_s", entry.tick * TICK) / TICK)
    kept = f"the walk is kept up to {tick * TICK:.3f} s, in {there[-1]}" if there else "no run is left of it"
    text = f"its processes were killed; {kept}"
    close_killed(records, entry.id, tick=tick, text=text, summary=summary, folders=there)
    return text
