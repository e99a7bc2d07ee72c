"""From the journal of a live walk to its run folder, at the end of the walk or whenever somebody looks."""

import json
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd

from twin_gait.configuration.documents import dump_yaml
from twin_gait.configuration.experiment_file import experiment_from_mapping
from twin_gait.exceptions import RunDirectoryError
from twin_gait.files import write_atomically
from twin_gait.gait.table import TICK
from twin_gait.live.journal import AppliedChange, Content, Piece, locked, next_free, read_journal, walk_of
from twin_gait.live.session_records import KILLED, SessionEntry, close_killed, list_sessions
from twin_gait.runs.folders import journal_of, staged_directory
from twin_gait.runs.record import RUN_DIRECTORY, SUMMARY_FILE, write_run
from twin_gait.simulation.engine import EngineResult, log_layout
from twin_gait.simulation.problem import Problem, build_problem
from twin_gait.simulation.run import Run
from twin_gait.simulation.simulator import run_of
from twin_gait.worlds.faults import parse_fault

CHANGES_FILE = "live_changes.csv"
TABLE_FILE = "live_table.yaml"
CHANGE_COLUMNS = ("tick", "time_s", "user", "subject", "before", "value", "text")
# Drawing takes about a tenth of the walk; nobody waits minutes for the pictures of an hour.
LONGEST_PICTURES = 120.0  # [s]


class Completed(NamedTuple):
    """A walk whose run folder is complete."""

    folder: Path  # the run folder
    summary: dict[str, Any]  # content of its ``summary.json``


def complete(
    journal: Path, *, pictures: bool = False, on_step: Callable[[str], None] | None = None
) -> Completed | None:
    """Make the run folder of a walk out of its journal, which then goes.

    ``journal``: the file; its walk has ended or its process is dead; ``pictures``: whether to draw figures
    and animation, where the set-up wants them and the walk is short; ``on_step``: called with the name of
    each file before it is written. Returns the folder, or None if not one tick had been walked. Raises
    RunDirectoryError if the journal cannot be read or is still being written, or the folder cannot be made.
    """
    with locked(journal):
        content = read_journal(journal)
        problem = build_problem(experiment_from_mapping(content.setup["document"], "experiment", Path()))
        if content.columns != log_layout(problem).names:
            raise RunDirectoryError(
                f"{journal}: its log has other columns than this version writes; use the version that made it"
            )
        walk = walk_of(content.pieces, len(content.columns), problem.experiment.n_ticks)
        done = None if len(walk.rows) == 0 else _write(content, walk, problem, pictures, on_step)
        journal.unlink()
    return done


def _write(
    content: Content, walk: Piece, problem: Problem, pictures: bool, on_step: Callable[[str], None] | None
) -> Completed:
    setup, run = content.setup, walked_run(walk, problem)
    folder, force = Path(setup["folder"]), bool(setup["force"])
    if folder.exists() and not force:  # somebody else's; what was walked is not lost for it
        folder = next_free(folder, 2)
    drawn = pictures and bool(setup["pictures"]) and run.duration <= LONGEST_PICTURES
    with staged_directory(folder, RUN_DIRECTORY, force=force) as staging:
        write_atomically(staging / CHANGES_FILE, changes_csv(walk.changes))
        if walk.table is not None:
            write_atomically(staging / TABLE_FILE, dump_yaml(dict(walk.table)))
        document = {**setup["document"], "duration_s": run.duration}
        summary = write_run(run, staging, document=document, pictures=drawn, on_step=on_step)
    return Completed(folder, summary)


def walked_run(walk: Piece, problem: Problem) -> Run:
    """A live walk as a run like any other; faults injected from a page are faults of its experiment.

    Returns the run, as long as it was walked.
    """
    experiment, ticks = problem.experiment, len(walk.rows)
    injected = [
        replace(parse_fault(change.note["fault"]), time=change.tick * TICK)
        for change in walk.changes
        if "fault" in change.note and change.tick < ticks
    ]
    faults = (*(item for item in experiment.faults if item.time < ticks * TICK), *injected)
    walked = replace(problem, experiment=replace(experiment, duration=round(ticks * TICK, 3), faults=faults))
    result = EngineResult(walk.rows, walk.switches, walk.status, walk.reason, walk.trip)
    return run_of(walked, result, walk.wall_s)


def complete_all(
    journals: Iterable[Path], tell: Callable[[Mapping[str, Any]], None], *, pictures: bool
) -> None:
    """Complete the walks of a session; only the last one is drawn, as nobody waits for twenty.

    ``journals`` in the order of the walks; those that somebody has completed already are passed over;
    ``tell``: takes a mapping before each step (``kind`` ``writing`` with ``step``) and after each walk
    (``folder`` with ``folder``, ``summary`` and ``failed``).
    """
    there = [path for path in journals if path.exists()]
    for number, journal in enumerate(there, start=1):
        which = f"walk {number} of {len(there)}: " if len(there) > 1 else ""

        def step(name: str, which: str = which) -> None:
            tell({"kind": "writing", "step": f"{which}{name}"})

        try:
            done = complete(journal, pictures=pictures and journal == there[-1], on_step=step)
            if done is not None:
                folder, summary = str(done.folder), done.summary
                tell({"kind": "folder", "folder": folder, "summary": summary, "failed": ""})
        except RunDirectoryError as error:
            failed = " ".join(str(error).split())
            tell({"kind": "folder", "folder": str(journal), "summary": {}, "failed": failed})


def changes_csv(changes: Iterable[AppliedChange]) -> str:
    """The changes of a walk as CSV.

    Returns one line per change: its first tick, who, what, and the values before and after.
    """
    rows = [{**change.note, "tick": change.tick, "time_s": f"{change.tick * TICK:.3f}"} for change in changes]
    table = pd.DataFrame(rows, columns=CHANGE_COLUMNS, dtype=object)
    return table.to_csv(index=False, lineterminator="\n")


def recover(records: Path) -> Iterator[str]:
    """Complete the run folders of all sessions that were killed, and close those sessions in the record.

    Yields one sentence for each session, as the record has it from then on. Raises SessionError if the record
    cannot be used.
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
