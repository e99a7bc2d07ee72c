"""The test kit as a pytest plugin: ``pytest --gait-table FILE [--machine c] [--approved FILE [--approve]]``.

Every pytest that finds this package loads the plugin. Therefore nothing of the package is imported before one
of the options is given, and no hook does anything without them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from twin_gait.gait.table import StateTable
    from twin_gait.testing.cases import MachineFactory


# Requested tests by file: its table, the factory of the machine under test (None for the package's own one),
# and the file of the approved text.
_REQUESTS = pytest.StashKey["dict[Path, tuple[StateTable, MachineFactory | None, Path | None]]"]()


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the options of the kit."""
    add = parser.getgroup("twin_gait", "gait tables").addoption
    text = "test every transition of a gait table"
    add("--gait-table", action="append", default=[], metavar="FILE", help=text)
    text = "machine under test: the package's state machine, or one with its guards in C as in the firmware"
    add("--machine", choices=("python", "c"), default="python", help=text)
    text = "compare the gait table with its approved text (Markdown); one for each --gait-table, in order"
    add("--approved", action="append", default=[], metavar="FILE", help=text)
    add("--approve", action="store_true", help="write the approved text instead of comparing")


def pytest_configure(config: pytest.Config) -> None:
    """Read the tables and add their files to the collection."""
    tables, approved = config.getoption("gait_table"), config.getoption("approved")
    approve, in_c = config.getoption("approve"), config.getoption("machine") == "c"
    if not (tables or approved or approve or in_c):
        return
    paths = [Path(name).resolve() for name in tables]
    expected = len(tables) if approved or approve else 0
    if not tables or len(approved) != expected or len(set(paths)) < len(paths):
        raise pytest.UsageError(
            "expected --gait-table FILE, each once, with --machine, and one --approved FILE for each with "
            "--approve"
        )
    texts: list[Path | None] = [*map(Path, approved)] or [None] * len(paths)
    requests = [(*_load(name, in_c), text) for name, text in zip(tables, texts, strict=True)]
    config.stash[_REQUESTS] = dict(zip(paths, requests, strict=True))
    config.args.extend(str(path) for path in paths if str(path) not in config.args)


def _load(name: str, in_c: bool) -> tuple[StateTable, MachineFactory | None]:
    """Load a table, and build its machine in C if ``in_c`` is True."""
    from twin_gait.configuration.gait_table_file import load_state_table
    from twin_gait.exceptions import TwinGaitError
    from twin_gait.gait.program import compile_guards
    from twin_gait.testing.compiled import compiled_machines

    try:
        table = load_state_table(name)
        compile_guards(table)
        return table, compiled_machines([table])[0] if in_c else None
    except TwinGaitError as error:
        raise pytest.UsageError(f"--gait-table {name}: {error}") from error


def pytest_collect_file(file_path: Path, parent: pytest.Collector) -> GaitTableTests | None:
    """Collect the files that the options name as gait tables."""
    if file_path.resolve() not in parent.config.stash.get(_REQUESTS, {}):
        return None
    collected: GaitTableTests = GaitTableTests.from_parent(parent, path=file_path)
    return collected


class GaitTableTests(pytest.File):
    """The tests of one gait table."""

    def collect(self) -> Iterator[pytest.Item]:
        """Yield the tests of the transitions, then the comparison with the approved text."""
        from twin_gait.testing.cases import transition_tests

        table, machine, approved = self.config.stash[_REQUESTS][self.path.resolve()]
        for test in transition_tests(table, machine):
            item = KitItem.from_parent(self, name=test.name, check=test.run)
            if test.undecided is not None:
                item.add_marker(pytest.mark.skip(reason=test.undecided))
            yield item
        if approved is not None:
            check = partial(self._approve, table, approved)
            yield KitItem.from_parent(self, name="approved text", check=check)

    def _approve(self, table: StateTable, path: Path) -> None:
        """Compare the text of the table with the approved one, or write it."""
        from twin_gait.exceptions import TwinGaitError
        from twin_gait.files import write_atomically
        from twin_gait.testing.cases import approval_text, check_approved

        text = approval_text(table)
        try:
            if self.config.getoption("approve"):
                path.parent.mkdir(parents=True, exist_ok=True)
                write_atomically(path, text)
            problem = check_approved(path, text)
        except (OSError, UnicodeDecodeError, TwinGaitError) as error:
            raise AssertionError(f"{path}: {error}") from error
        if problem is not None:
            hint = f"approve it with: pytest --gait-table {self.path} --approved {path} --approve"
            raise AssertionError(f"{problem}\n{hint}")


class KitItem(pytest.Item):
    """A test whose failure is reported by its message, without a traceback through the kit."""

    def __init__(self, *, check: Callable[[], None], **rest: Any) -> None:
        """Store the function that performs the test."""
        super().__init__(**rest)
        self.check = check

    def runtest(self) -> None:
        """Perform the test."""
        self.check()

    def repr_failure(self, excinfo: pytest.ExceptionInfo[BaseException], style: Any = None) -> Any:
        """Return the message of a failure."""
        if isinstance(excinfo.value, AssertionError):
            return str(excinfo.value)
        return super().repr_failure(excinfo, style)

    def reportinfo(self) -> tuple[Path, int, str]:
        """Return the file and the name of the test."""
        return self.path, 0, self.name.replace("::", ": ")
