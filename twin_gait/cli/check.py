"""``twin-gait check``."""

from __future__ import annotations

import argparse
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from twin_gait.cli import options
from twin_gait.cli.terminal import DONE, FAILED, answer
from twin_gait.exceptions import ParameterError

if TYPE_CHECKING:
    from twin_gait.checking.finding import Finding

WIDTH = 100


def add_parser(commands: Any) -> None:
    """Add the command to the parser."""
    parser = options.add_command(commands, "check", run)
    add = parser.add_argument
    add("table", nargs="?", metavar="TABLE", help="packaged table or YAML file")
    add(
        "--experiment",
        metavar="FILE",
        help="preset, experiment file or run directory that it drives; without TABLE its own is checked",
    )
    options.add_settings(parser)
    options.add_json(parser)
    add("--rules", action="store_true", help="list the rules and end")


def run(arguments: argparse.Namespace) -> int:
    """Check a gait table without a run.

    Check a gait table: exits that contend, follow at once or never open, phases that cannot be reached or
    left, both legs in swing, and more. Ends with 1 if there is an error.
    """
    from twin_gait.checking.check import check, counts, load_case, report, rules

    if arguments.rules:
        width = max(map(len, rules()))
        answer(arguments, [f"{name:<{width}}  {meaning}" for name, meaning in rules().items()], rules)
        return DONE
    if arguments.table is None and arguments.experiment is None:
        raise ParameterError("check: expected a gait table or --experiment; --rules lists the rules")
    case = load_case(arguments.table, arguments.experiment, arguments.settings)
    findings = check(case)
    against = "by itself" if case.experiment is None else f"against {case.experiment.name}"
    last = f"{case.table.name}, {against}: {counted(counts(findings))}"
    answer(arguments, [*draw(findings), last], lambda: report(case, findings))
    return FAILED if counts(findings)["errors"] else DONE


def draw(findings: Sequence[Finding]) -> Iterator[str]:
    """Findings as lines, grouped by severity; a waived one in two lines at the end of its group."""
    for finding in findings:
        yield f"{'waived ' if finding.waived else ''}{heading(finding)}"
        texts = [finding.waived or finding.reason]
        if finding.counterexample and not finding.waived:
            signals = finding.counterexample.items()
            at = [f"{name} {x if isinstance(x, str) else format(x, '.7g')}" for name, x in signals]
            texts.append(f"at {', '.join(at)}")
        if finding.severity != "note" and not finding.waived:
            texts.append(f"→ {finding.suggestion}")
        for text in texts:
            yield from textwrap.wrap(text, WIDTH, initial_indent="    ", subsequent_indent="    ")


def heading(finding: Finding) -> str:
    """Severity, rule and place of a finding."""
    parts = [str(part) for part in (finding.transition or finding.phase, finding.side) if part is not None]
    return f"{finding.severity} {finding.rule}" + (f": {' · '.join(parts)}" if parts else "")


def counted(numbers: Mapping[str, int]) -> str:
    """Numbers of findings in words, by the plurals that name them."""
    parts = []
    for plural, number in numbers.items():
        word = plural if number != 1 or plural == "waived" else plural.removesuffix("s")
        parts.append(f"{number} {word}")
    return ", ".join(parts)
