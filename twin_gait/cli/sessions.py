"""``twin-gait sessions``: the record of live sessions, and the incomplete folders of killed runs."""

from __future__ import annotations

import argparse
import json
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from twin_gait.cli import options
from twin_gait.cli.terminal import DONE, FAILED, answer
from twin_gait.exceptions import RunDirectoryError
from twin_gait.files import private_files, write_atomically
from twin_gait.report.pages import lines
from twin_gait.runs import folders

_ABOUT = "Manage the record of twin-gait live: user, time and value of every change, and the run folders."


def add_parser(commands: Any) -> None:
    """Add the command to the parser."""
    parser = commands.add_parser("sessions", help="manage live sessions and killed runs", description=_ABOUT)
    parser.add_argument("--records", type=Path, metavar="DIR", help="folder of the record (the user's own)")
    actions = parser.add_subparsers(dest="action", required=True, metavar="ACTION", parser_class=type(parser))
    action = options.add_command(actions, "list", list_sessions)
    action.add_argument("--user", metavar="NAME", help="only the sessions of this user")
    action.add_argument("--name", metavar="NAME", help="only the sessions of the patient of this name")
    options.add(action, "--json")
    for name, act in (("export", export_session), ("show", show_session), ("delete", delete_session)):
        action = options.add_command(actions, name, act)
        action.add_argument("session", type=int, help="number of the session")
    action = options.add_command(actions, "report", report_session)
    action.add_argument("session", type=int, nargs="?", help="number of the session (the newest one)")
    options.add_out(action, "FILE.html", "file to write (RUN-report.html next to the first run directory)")
    action = options.add_command(actions, "complete", complete_run)
    action.add_argument("folder", type=Path, metavar="DIR", help="run directory of the session")
    action = options.add_command(actions, "clean", clean)
    action.add_argument(
        "folder", nargs="?", type=Path, default=Path("runs"), metavar="DIR", help="folder (runs)"
    )
    action.add_argument("--yes", action="store_true", help="remove the folders instead of only listing them")


def _records(arguments: argparse.Namespace) -> Path:
    from twin_gait.live.session_records import default_records

    given: Path | None = arguments.records
    return given or default_records()


def list_sessions(arguments: argparse.Namespace) -> int:
    """List the sessions, one line each, the newest first."""
    from twin_gait.live import session_records

    entries = session_records.list_sessions(_records(arguments), arguments.user, arguments.name)
    answer(arguments, [format_session(entry) for entry in entries] or ["no sessions"], entries)
    return DONE


def format_session(entry: Mapping[str, Any]) -> str:
    """Format one line on a session: number, time, user, patient, experiment, status, changes and folders.

    Characters of the record that cannot be printed are replaced, so that none can control the terminal.
    """
    user, began = entry["user"] or "(no user name)", entry["began"][:16].replace("T", " ")
    counted = "{changes} changes, {refusals} rejected, {versions} table versions".format_map(entry)
    left = {path: f"{path} (unfinished: twin-gait sessions complete {path})" for path in entry["unfinished"]}
    folders = ", ".join(left.get(path, path) for path in entry["folders"]) or "no run folder"
    run = "{experiment}  {status}".format_map(entry)
    named = entry["patient"] not in (None, entry["experiment"])
    run = f"{entry['patient']} in {run}" if named else run
    line = f"{entry['id']:>4}  {began} UTC  {user}  {run}  {counted}  {folders}"
    return "".join(sign if sign.isprintable() else "\N{REPLACEMENT CHARACTER}" for sign in line)


def show_session(arguments: argparse.Namespace) -> int:
    """Show one session with every change."""
    from twin_gait.live import session_records

    found = session_records.read_session(_records(arguments), arguments.session)
    print("\n".join(lines("session.txt", {"head": format_session(found), "log": found["log"]})))
    return DONE


def export_session(arguments: argparse.Namespace) -> int:
    """Print one session as JSON, including table versions."""
    from twin_gait.live import session_records

    found = session_records.read_session(_records(arguments), arguments.session)
    print(json.dumps(found, indent=2, ensure_ascii=False))
    return DONE


def report_session(arguments: argparse.Namespace) -> int:
    """Write the report of a session for print.

    Write one page with the changes of a session, its strides by condition, faults and stops, two pictures,
    and a comparison with the last session of the same patient. Nothing is sent over a network.
    """
    from twin_gait.live import session_records
    from twin_gait.live.session_report import session_report

    records, number = _records(arguments), arguments.session
    if number is None:
        entries = session_records.list_sessions(records)
        if not entries:
            raise session_records.SessionError(f"{records}: has no session yet; twin-gait live records them")
        number = entries[0]["id"]
    out = arguments.out
    if out is None:
        first = Path(session_records.read_session(records, number)["folders"][0])
        out = first.with_name(f"{first.name}-report.html")
    options.check_file("--out", out.expanduser(), force=arguments.force, form="html")
    page = session_report(records, number)
    with private_files():
        write_atomically(out.expanduser(), page)
    print(out)
    return DONE


def delete_session(arguments: argparse.Namespace) -> int:
    """Delete a session from the record; its run folders stay."""
    from twin_gait.live import session_records

    session_records.delete_session(_records(arguments), arguments.session)
    print(f"session {arguments.session} deleted; its run folders were kept")
    return DONE


def complete_run(arguments: argparse.Namespace) -> int:
    """Write the run directory of a killed session, up to its last second."""
    from twin_gait.live import journal

    done = journal.complete(folders.journal_path(arguments.folder.expanduser().absolute()))
    print("\n".join(map(str, done)) or "nothing was written, because no tick had been simulated")
    return DONE


def clean(arguments: argparse.Namespace) -> int:
    """List or remove the incomplete folders of killed runs."""
    folder = arguments.folder.expanduser()
    if not folder.is_dir():
        raise RunDirectoryError(f"{folder}: there is no such folder; check the path")
    found = folders.find_abandoned_folders(folder)
    for path in found:
        print(path)
        if arguments.yes:
            shutil.rmtree(path)
    if not found:
        print(f"there are no folders of killed runs in {folder}")
    elif not arguments.yes:
        print("no folder was removed; add --yes to remove them")
        return FAILED
    return DONE
