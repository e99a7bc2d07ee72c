"""``twin-gait sessions``."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from twin_gait.cli.terminal import DONE

if TYPE_CHECKING:
    from twin_gait.live.session_records import SessionEntry


def add_parser(commands: Any) -> None:
    """Add the command to the parser."""
    parser = commands.add_parser(
        "sessions",
        help="list, show, export or delete the record of live sessions",
        description=(
            "The record of twin-gait live: who changed what, when, and where the run is. Walks whose "
            "processes were killed are completed first, up to the last second that they wrote."
        ),
    )
    parser.add_argument("--records", type=Path, metavar="DIR", help="record to read (that of this user)")
    actions = parser.add_subparsers(dest="action", required=True, metavar="ACTION", parser_class=type(parser))
    listing = actions.add_parser("list", help="one line per session, the newest first")
    listing.add_argument("--user", help="only the sessions of this user")
    listing.set_defaults(act=_list)
    showing = actions.add_parser("show", help="one session with every change")
    showing.add_argument("session", type=int, help="number of the session")
    showing.set_defaults(act=_show)
    exporting = actions.add_parser("export", help="one session as JSON, table versions included")
    exporting.add_argument("session", type=int, help="number of the session")
    exporting.add_argument("--out", type=Path, metavar="FILE", help="file to write (standard output)")
    exporting.set_defaults(act=_export)
    deleting = actions.add_parser("delete", help="take a session out of the record; its run folders stay")
    deleting.add_argument("session", type=int, help="number of the session")
    deleting.set_defaults(act=_delete)
    completing = actions.add_parser("complete", help="complete a killed walk that was kept out of the record")
    completing.add_argument("folder", type=Path, help="the run directory to be")
    completing.set_defaults(act=_complete)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Do what was asked for with the record."""
    from twin_gait.live.recovery import recover
    from twin_gait.live.session_records import default_records

    records = arguments.records or default_records()
    if arguments.act is not _complete:
        for told in recover(records):
            print(f"twin-gait sessions: {told}", file=sys.stderr)
    arguments.act(arguments, records)
    return DONE


def _list(arguments: argparse.Namespace, records: Path) -> None:
    from twin_gait.live.session_records import list_sessions

    entries = list_sessions(records, arguments.user)
    for entry in entries:
        print(line_of(entry))
    if not entries:
        print("no sessions" if arguments.user is None else f"no sessions of {arguments.user}")


def line_of(entry: SessionEntry) -> str:
    """One line on a session.

    Args:
        entry: The session.

    Returns:
        Number, time, user, experiment, status, changes and folder.
    """
    who = entry.user or "(nobody named)"
    began = entry.began[:16].replace("T", " ")
    counted = f"{entry.changes} changes, {entry.refusals} refused, {entry.versions} table versions"
    folder = entry.folders[-1] if entry.folders else "no run folder"
    return f"{entry.id:>4}  {began} UTC  {who}  {entry.experiment}  {entry.status}  {counted}  {folder}"


def _show(arguments: argparse.Namespace, records: Path) -> None:
    from twin_gait.live.session_records import list_sessions, read_session

    found = read_session(records, arguments.session)
    print(next(line_of(item) for item in list_sessions(records) if item.id == arguments.session))
    for item in found["log"]:
        who = f" {item['user']}" if item["user"] else ""
        about = f"{item['subject']}: " if item["outcome"] == "refused" and item["subject"] else ""
        print(f"  tick {item['tick']:>7}  {item['outcome']}{who}  {about}{item['text']}")


def _export(arguments: argparse.Namespace, records: Path) -> None:
    from twin_gait.files import write_atomically
    from twin_gait.live.session_records import read_session

    text = json.dumps(read_session(records, arguments.session), indent=2, ensure_ascii=False) + "\n"
    if arguments.out is None:
        print(text, end="")
        return
    write_atomically(arguments.out, text)
    print(arguments.out)


def _delete(arguments: argparse.Namespace, records: Path) -> None:
    from twin_gait.live.session_records import delete_session

    delete_session(records, arguments.session)
    print(f"session {arguments.session} deleted; its run folders stay")


def _complete(arguments: argparse.Namespace, records: Path) -> None:
    from twin_gait.live.finishing import complete
    from twin_gait.runs.folders import journal_of

    done = complete(journal_of(arguments.folder.expanduser().absolute()))
    print("nothing had been walked" if done is None else done.folder)
