"""``twin-gait sessions``: the record of live sessions, and what killed runs have left behind."""

from __future__ import annotations

import argparse
import json
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from twin_gait import live
from twin_gait.cli import options
from twin_gait.cli.terminal import DONE, FAILED, answer
from twin_gait.exceptions import RunDirectoryError
from twin_gait.report.pages import lines
from twin_gait.runs import folders

_ABOUT = "The record of twin-gait live: who changed what, when, and where the run is."


def add_parser(commands: Any) -> None:
    """Add the command to the parser."""
    parser = commands.add_parser("sessions", help="manage live sessions and killed runs", description=_ABOUT)
    parser.add_argument("--records", type=Path, metavar="DIR", help="record to read (that of this user)")
    actions = parser.add_subparsers(dest="action", required=True, metavar="ACTION", parser_class=type(parser))
    action = options.add_command(actions, "list", list_sessions)
    action.add_argument("--user", metavar="NAME", help="only the sessions of this user")
    options.add(action, "--json")
    for name, act in (("export", export_session), ("show", show_session), ("delete", delete_session)):
        action = options.add_command(actions, name, act)
        action.add_argument("session", type=int, help="number of the session")
    action = options.add_command(actions, "complete", complete_run)
    action.add_argument("folder", type=Path, metavar="DIR", help="the run directory to be")
    action = options.add_command(actions, "clean", clean)
    action.add_argument("folder", nargs="?", type=Path, default=Path("runs"), metavar="DIR", help="(runs)")
    action.add_argument("--yes", action="store_true", help="remove them")


def _records(arguments: argparse.Namespace) -> Path:
    return arguments.records or live.session_records.default_records()


def list_sessions(arguments: argparse.Namespace) -> int:
    """One line per session, the newest first."""
    entries = live.session_records.list_sessions(_records(arguments), arguments.user)
    answer(arguments, [line_of(entry) for entry in entries] or ["no sessions"], entries)
    return DONE


def line_of(entry: Mapping[str, Any]) -> str:
    """One line on a session: number, time, user, experiment, status, changes and folders.

    Whatever stands in the record, nothing in it moves the cursor of a terminal.
    """
    who, began = entry["user"] or "(nobody named)", entry["began"][:16].replace("T", " ")
    counted = "{changes} changes, {refusals} refused, {versions} table versions".format_map(entry)
    left = {path: f"{path} (unfinished: twin-gait sessions complete {path})" for path in entry["unfinished"]}
    folders = ", ".join(left.get(path, path) for path in entry["folders"]) or "no run folder"
    what = "{experiment}  {status}".format_map(entry)
    line = f"{entry['id']:>4}  {began} UTC  {who}  {what}  {counted}  {folders}"
    return "".join(sign if sign.isprintable() else "\N{REPLACEMENT CHARACTER}" for sign in line)


def show_session(arguments: argparse.Namespace) -> int:
    """One session with every change."""
    found = live.session_records.read_session(_records(arguments), arguments.session)
    print("\n".join(lines("session.txt", {"head": line_of(found), "log": found["log"]})))
    return DONE


def export_session(arguments: argparse.Namespace) -> int:
    """Print one session as JSON, table versions included."""
    found = live.session_records.read_session(_records(arguments), arguments.session)
    print(json.dumps(found, indent=2, ensure_ascii=False))
    return DONE


def delete_session(arguments: argparse.Namespace) -> int:
    """Take a session out of the record; its run folders stay."""
    live.session_records.delete_session(_records(arguments), arguments.session)
    print(f"session {arguments.session} deleted; its run folders stay")
    return DONE


def complete_run(arguments: argparse.Namespace) -> int:
    """Make the run directory of a session that was killed, up to its last second."""
    done = live.journal.complete(folders.journal_of(arguments.folder.expanduser().absolute()))
    print("\n".join(map(str, done)) or "nothing had been simulated")
    return DONE


def clean(arguments: argparse.Namespace) -> int:
    """List and remove the incomplete folders that killed runs have left behind."""
    folder = arguments.folder.expanduser()
    if not folder.is_dir():
        raise RunDirectoryError(f"{folder}: no such folder")
    found = folders.abandoned(folder)
    for path in found:
        print(path)
        if arguments.yes:
            shutil.rmtree(path)
    if not found:
        print(f"nothing of killed runs in {folder}")
    elif not arguments.yes:
        print("nothing was removed (--yes removes them)")
        return FAILED
    return DONE
