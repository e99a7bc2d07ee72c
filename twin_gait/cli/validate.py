"""``twin-gait validate``."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from twin_gait.cli.options import check_file
from twin_gait.cli.terminal import DONE, FAILED, progress_bar


def add_parser(commands: Any) -> None:
    """Add the command to the parser."""
    parser = commands.add_parser(
        "validate",
        help="check this installation against independent witnesses",
        description=(
            "Compare dynamics, integrators, engines and laws with MuJoCo, closed forms and conservation "
            "laws, and print what was found. Ends with 1 if a check fails."
        ),
    )
    parser.add_argument("--only", action="append", default=[], metavar="NAME", help="one check (repeatable)")
    parser.add_argument("--json", type=Path, metavar="FILE", help="also write the checks as JSON")
    parser.add_argument("--force", action="store_true", help="replace an existing file")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Run the checks and print the table."""
    import json

    from twin_gait.files import write_atomically
    from twin_gait.studies.validation.validation import (
        all_passed,
        checks_document,
        chosen_checks,
        draw_checks,
        validate,
    )

    plans = chosen_checks(arguments.only)
    if arguments.json is not None:
        check_file("--json", arguments.json, force=arguments.force)
    with progress_bar("checking", "check") as progress:
        checks = validate(plans, progress=progress)
    print(draw_checks(checks))
    if arguments.json is not None:
        text = json.dumps(checks_document(checks), indent=2, ensure_ascii=False, allow_nan=False)
        write_atomically(arguments.json, f"{text}\n")
    return DONE if all_passed(checks) else FAILED
