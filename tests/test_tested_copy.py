"""Conditions under which a test would pass without a test: an old copy of the package, a missing browser."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from tested_copy import CHECKOUT, copies_in_use, describe_mismatch


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder like that of a plain install, with the models next to the code."""
    folder = tmp_path_factory.mktemp("site") / "twin_gait"
    without = shutil.ignore_patterns("__pycache__")
    shutil.copytree(CHECKOUT / "twin_gait", folder, ignore=without)
    shutil.copytree(CHECKOUT / "urdf", folder / "urdf", ignore=without)
    return folder


def test_tested_package_is_the_checkout() -> None:
    assert [describe_mismatch(copy) for copy in copies_in_use()] == [None, None]


def test_an_equal_copy_will_do(installed: Path) -> None:
    assert describe_mismatch(installed) is None


def test_an_edit_a_new_file_and_a_lost_one_are_found(installed: Path, tmp_path: Path) -> None:
    copy = shutil.copytree(installed, tmp_path / "twin_gait")
    law = copy / "core" / "impedance.py"
    text = law.read_text()
    law.write_text(text.replace("stiffness", "hardness"))
    assert "core/impedance.py" in str(describe_mismatch(copy))
    law.write_text(text)
    assert describe_mismatch(copy) is None
    (copy / "core" / "new.py").touch()
    assert "core/new.py" in str(describe_mismatch(copy))
    (copy / "core" / "new.py").unlink()
    (copy / "urdf" / "twin.urdf").unlink()
    assert "urdf/twin.urdf" in str(describe_mismatch(copy))
    assert "not installed" in str(describe_mismatch(None))


def test_pytest_ends_at_once_with_one_line(installed: Path, tmp_path: Path) -> None:
    copy = shutil.copytree(installed, tmp_path / "twin_gait")
    (copy / "core" / "friction.py").write_text("")
    command = [sys.executable, "-P", "-m", "pytest", "-n", "0", str(CHECKOUT / "tests" / "test_readme.py")]
    done = subprocess.run(
        command, capture_output=True, text=True, check=False, cwd=CHECKOUT, env={"PYTHONPATH": str(tmp_path)}
    )
    assert done.returncode == 4
    shown = [line for line in (done.stdout + done.stderr).splitlines() if "core/friction.py" in line]
    assert len(shown) == 1 and "pip install -e" in shown[0]
    assert "passed" not in done.stdout and "Traceback" not in done.stdout + done.stderr


SKIPS = """
import pytest
{}
def test_a_page():
    {}
"""
MISSING = "pytest.skip('no Chromium on this machine', allow_module_level=True)"
OTHER = "pytest.skip('root may write everywhere')"


@pytest.mark.parametrize(
    ("module", "test", "required", "status"),
    [
        (MISSING, "pass", "", pytest.ExitCode.NO_TESTS_COLLECTED),
        (MISSING, "pass", "1", pytest.ExitCode.INTERRUPTED),
        ("", "pytest.importorskip('nothing', reason='playwright is not installed')", "1", 1),
        ("", "pytest.importorskip('nothing', reason='playwright is not installed')", "", 0),
        ("", OTHER, "1", 0),
    ],
)
def test_a_browser_that_should_be_there_is_not_skipped(
    tmp_path: Path, module: str, test: str, required: str, status: int
) -> None:
    (tmp_path / "conftest.py").write_bytes((CHECKOUT / "tests" / "conftest.py").read_bytes())
    (tmp_path / "test_page.py").write_text(SKIPS.format(module, test))
    environment = {"PYTHONPATH": f"{CHECKOUT / 'tests'}:{CHECKOUT}", "TWIN_GAIT_REQUIRE_BROWSER": required}
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-n",
        "0",
        "-c",
        "/dev/null",
        "--rootdir",
        str(tmp_path),
        str(tmp_path),
    ]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path, env=environment)
    assert done.returncode == status, done.stdout
