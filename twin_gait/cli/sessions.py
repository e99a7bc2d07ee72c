"""``twin-gait sessions``: the record of live sessions, and what killed runs have left behind."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from twin_gait import live
from twin_gait.cli import options
from twin_gait.cli.terminal import DONE, FAILED, answer
from twin_gait.exceptions import RunDirectoryError
from twin_gait.files import write_atomically
from twin_gait.runs import folders


def add_parser(commands: Any) -> None:
    """Add the command to the parser."""
    parser = options.add_command(commands, "sessions", run)
    parser.add_argument("--records", type=Path, metavar="DIR", help="record to read (that of this user)")
    actions = parser.add_subparsers(dest="action", required=True, metavar="ACTION", parser_class=type(parser))
    for name, (act, text) in _ACTIONS.items():
        action = actions.add_parser(name, help=text, description=text)
        action.set_defaults(act=act)
        if name == "list":
            action.add_argument("--user", metavar="NAME", help="only the sessions of this user")
            options.add(action, "--json")
        elif name == "complete":
            action.add_argument("folder", type=Path, metavar="DIR", help="the run directory to be")
        elif name == "clean":
            folder = Path("runs")
            action.add_argument("folder", nargs="?", type=Path, default=folder, metavar="DIR", help="(runs)")
            action.add_argument("--yes", action="store_true", help="remove them without asking")
        else:
            action.add_argument("session", type=int, help="number of the session")
        if name == "export":
            options.add_out(action, "FILE", "file to write (standard output)")


def run(arguments: argparse.Namespace) -> int:
    """Manage live sessions and killed runs.

    The record of twin-gait live: who changed what, when, and where the run is.
    """
    records = arguments.records or live.session_records.default_records()
    status: int | None = arguments.act(arguments, records)
    return DONE if status is None else status


def _list(arguments: argparse.Namespace, records: Path) -> None:
    entries = live.session_records.list_sessions(records, arguments.user)
    nobody = "no sessions" if arguments.user is None else f"no sessions of {arguments.user}"
    lines = [line_of(entry) for entry in entries] or [nobody]
    answer(arguments, lines, lambda: entries)


def line_of(entry: Mapping[str, Any]) -> str:
    """One line on a session: number, time, user, experiment, status, changes and folder."""
    who, began = entry["user"] or "(nobody named)", entry["began"][:16].replace("T", " ")
    counted = "{changes} changes, {refusals} refused, {versions} table versions".format_map(entry)
    folder = entry["folders"][-1] if entry["folders"] else "no run folder"
    return (
        f"{entry['id']:>4}  {began} UTC  {who}  {entry['experiment']}  {entry['status']}  {counted}  {folder}"
    )


def _show(arguments: argparse.Namespace, records: Path) -> None:
    found = live.session_records.read_session(records, arguments.session)
    print(line_of(found))
    for item in found["log"]:
        who = f" {item['user']}" if item["user"] else ""
        about = f"{item['subject']}: " if item["response"] == "refused" and item["subject"] else ""
        print(f"  tick {item['tick']:>7}  {item['response']}{who}  {about}{item['text']}")


def _export(arguments: argparse.Namespace, records: Path) -> None:
    if arguments.out is not None:
        options.check_file("--out", arguments.out, force=arguments.force)
    found = live.session_records.read_session(records, arguments.session)
    text = json.dumps(found, indent=2, ensure_ascii=False) + "\n"
    if arguments.out is None:
        print(text, end="")
        return
    write_atomically(arguments.out, text)
    print(arguments.out)


def _delete(arguments: argparse.Namespace, records: Path) -> None:
    live.session_records.delete_session(records, arguments.session)
    print(f"session {arguments.session} deleted; its run folders stay")


def _complete(arguments: argparse.Namespace, records: Path) -> None:
    done = live.journal.complete(folders.journal_of(arguments.folder.expanduser().absolute()))
    print("\n".join(map(str, done)) or "nothing had been simulated")


def _clean(arguments: argparse.Namespace, records: Path) -> int:
    folder = arguments.folder.expanduser()
    if not folder.is_dir():
        raise RunDirectoryError(f"{folder}: no such folder")
    found = folders.abandoned(folder)
    for path in found:
        size = sum(item.stat().st_size for item in path.rglob("*") if item.is_file())
        print(f"{path}  {size / 1e6:.1f} MB")
    if not found:
        print(f"nothing of killed runs in {folder}")
        return DONE
    agreed = arguments.yes or (
        sys.stdin.isatty() and input("remove them? [y/N] ").strip().lower() in ("y", "yes")
    )
    if not agreed:
        print("nothing was removed (--yes removes them)")
        return FAILED
    for path in found:
        folders.remove_abandoned(path)
    return DONE


_ACTIONS: dict[str, tuple[Callable[[argparse.Namespace, Path], int | None], str]] = {
    "list": (_list, "one line per session, the newest first"),
    "export": (_export, "one session as JSON, table versions included"),
    "show": (_show, "one session with every change"),
    "delete": (_delete, "take a session out of the record; its run folders stay"),
    "complete": (_complete, "make the run directory of a session that was killed, up to its last second"),
    "clean": (_clean, "list and remove the incomplete folders that killed runs have left behind"),
}
