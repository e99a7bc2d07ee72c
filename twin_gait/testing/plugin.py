"""The test kit as a pytest plugin: ``pytest --gait-table FILE [--machine c] [--approved FILE [--approve]]``.

Every pytest that finds this package loads the plugin, so nothing of the package is imported before one
of the options is given, and without them no hook does anything.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import pytest

if TYPE_CHECKING:
    from twin_gait.gait.table import StateTable
    from twin_gait.testing.cases import TransitionTest
    from twin_gait.testing.driver import MachineFactory


class Request(NamedTuple):
    """A table to be tested."""

    table: StateTable
    machine: MachineFactory | None  # what is tested; None is the package's own
    approved: Path | None  # file with its approved text
    approve: bool  # whether that file is to be written instead of compared


_REQUESTS = pytest.StashKey[dict[Path, Request]]()


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the options."""
    group = parser.getgroup("twin_gait", "gait tables")
    group.addoption(
        "--gait-table",
        action="append",
        default=[],
        metavar="FILE",
        help="test every transition of a gait table",
    )
    group.addoption(
        "--machine",
        choices=("python", "c"),
        default="python",
        help="what is tested: the package's state machine, or its guards in C as the firmware has them",
    )
    group.addoption(
        "--approved",
        action="append",
        default=[],
        metavar="FILE",
        help="compare the gait table with its approved text (Markdown); one for each --gait-table, in order",
    )
    group.addoption("--approve", action="store_true", help="write the approved text instead of comparing")


def pytest_configure(config: pytest.Config) -> None:
    """Read the tables and have their files collected."""
    tables, approved = config.getoption("gait_table"), config.getoption("approved")
    approve, in_c = bool(config.getoption("approve")), config.getoption("machine") == "c"
    if not (tables or approved or approve or in_c):
        return
    _check_options(tables, approved, approve, in_c)
    texts: list[Path | None] = [Path(name) for name in approved]
    texts = texts or [None] * len(tables)
    requests = {
        Path(name).resolve(): Request(*_load(name, in_c), text, approve)
        for name, text in zip(tables, texts, strict=True)
    }
    config.stash[_REQUESTS] = requests
    config.args.extend(str(path) for path in requests if str(path) not in config.args)


def _check_options(tables: list[str], approved: list[str], approve: bool, in_c: bool) -> None:
    if in_c and not tables:
        raise pytest.UsageError("--machine c: expected --gait-table FILE with it")
    if approved and len(approved) != len(tables):
        raise pytest.UsageError(
            f"--approved: expected one for each --gait-table, got {len(approved)} for {len(tables)}"
        )
    if approve and not approved:
        raise pytest.UsageError("--approve: expected --gait-table FILE --approved FILE with it")
    twice = len(tables) - len({Path(name).resolve() for name in tables})
    if twice:
        raise pytest.UsageError("--gait-table: a file is named twice; name each once")


def _load(name: str, in_c: bool) -> tuple[StateTable, MachineFactory | None]:
    from twin_gait.configuration.gait_table_file import load_state_table
    from twin_gait.exceptions import TwinGaitError
    from twin_gait.gait.program import compile_guards

    try:
        table = load_state_table(name)
        compile_guards(table)
    except TwinGaitError as error:
        raise pytest.UsageError(f"--gait-table: {error}") from error
    try:
        return table, _in_c(table) if in_c else None
    except TwinGaitError as error:
        raise pytest.UsageError(f"--machine c: {name}: {error}") from error


def _in_c(table: StateTable) -> MachineFactory:
    from twin_gait.testing.compiled import compiled_machines

    (machine,) = compiled_machines([table])
    return machine


def pytest_collect_file(file_path: Path, parent: pytest.Collector) -> GaitTableTests | None:
    """Take the files that were named as gait tables."""
    request = parent.config.stash.get(_REQUESTS, {}).get(file_path.resolve())
    if request is None:
        return None
    collected: GaitTableTests = GaitTableTests.from_parent(parent, path=file_path, request=request)
    return collected


class GaitTableTests(pytest.File):
    """The tests of one gait table."""

    def __init__(self, *, request: Request, **rest: Any) -> None:
        """Keep the table."""
        super().__init__(**rest)
        self.request = request

    def collect(self) -> Iterator[pytest.Item]:
        """The tests of its transitions, then the approval."""
        from twin_gait.testing.cases import transition_tests

        for test in transition_tests(self.request.table, machine=self.request.machine):
            yield TransitionItem.from_parent(self, name=test.name, test=test)
        if self.request.approved is not None:
            yield ApprovalItem.from_parent(self, name="approved text", request=self.request)


class OneLineItem(pytest.Item):
    """An item whose failure is told by its message, without a traceback through the kit."""

    def repr_failure(self, excinfo: pytest.ExceptionInfo[BaseException], style: Any = None) -> Any:
        """Write the failure."""
        if isinstance(excinfo.value, AssertionError):
            return str(excinfo.value)
        return super().repr_failure(excinfo, style)

    def reportinfo(self) -> tuple[Path, int | None, str]:
        """Say where the test comes from."""
        return self.path, None, self.name.replace("::", ": ")


class TransitionItem(OneLineItem):
    """One test of the kit."""

    def __init__(self, *, test: TransitionTest, **rest: Any) -> None:
        """Keep the test."""
        super().__init__(**rest)
        self.test = test

    def runtest(self) -> None:
        """Drive the machine."""
        if self.test.undecided is not None:
            pytest.skip(self.test.undecided)
        self.test.run()


class ApprovalItem(OneLineItem):
    """The text of the table is the one that was approved."""

    def __init__(self, *, request: Request, **rest: Any) -> None:
        """Keep the table and the file."""
        super().__init__(**rest)
        self.request = request

    def runtest(self) -> None:
        """Compare, or write."""
        from twin_gait.exceptions import TwinGaitError
        from twin_gait.testing.cases import approval_text, check_approved, write_approved

        path = self.request.approved
        assert path is not None  # only made with one
        text = approval_text(self.request.table)
        try:
            if self.request.approve:
                write_approved(path, text)
                return
            problem = check_approved(path, text)
        except TwinGaitError as error:
            raise AssertionError(str(error)) from error
        if problem is not None:
            how = f"approve it with: pytest --gait-table {self.path} --approved {path} --approve"
            raise AssertionError(f"{problem}\n{how}")
