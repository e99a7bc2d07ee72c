"""Tests of the parts of a release: version, citation, changelog, licences, notes and templates."""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
import yaml

import twin_gait

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
NEXT = PROJECT["tool"]["hatch"]["version"]["fallback-version"]


def test_the_version_of_a_bare_checkout_equals_the_build():
    source = (ROOT / "twin_gait" / "__init__.py").read_text(encoding="utf-8")
    assert f'__version__ = "{NEXT}"' in source
    assert re.match(r"\d+\.\d+\.\d+", twin_gait.__version__)


def test_the_citation_names_the_same_release_and_licence():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert citation["version"] == NEXT.removesuffix(".dev0")
    assert citation["license"] == PROJECT["project"]["license"]


def test_the_changelog_is_in_the_usual_form():
    text = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert "## [Unreleased]" in text
    for release in re.split(r"^## ", text, flags=re.MULTILINE)[1:]:
        kinds = re.findall(r"^### (.*)$", release, flags=re.MULTILINE)
        assert len(kinds) == len(set(kinds))
        assert set(kinds) <= {"Added", "Changed", "Deprecated", "Removed", "Fixed", "Security"}


def listed(section: str) -> set[str]:
    page = (ROOT / "docs" / "reference" / "licences.md").read_text(encoding="utf-8")
    (block,) = re.findall(rf"<!-- licences {section} -->(.*?)<!-- / -->", page, flags=re.DOTALL)
    return set(re.findall(r"^\| `([\w.-]+)` \| \S", block, flags=re.MULTILINE))


EXTRAS = ("can", "cluster", "floor", "mocap", "mcap", "robots", "browser", "test", "docs")


@pytest.mark.parametrize("extra", ["package", *EXTRAS])
def test_every_requirement_has_a_licence_in_the_page(extra):
    project = PROJECT["project"]
    wanted = project["dependencies"] if extra == "package" else project["optional-dependencies"][extra]
    names = {re.split(r"[<>=\[; ]", text, maxsplit=1)[0].lower() for text in wanted}
    assert listed(extra) == names - {"twin-gait"}, "run python docs/insert.py"


def test_the_required_python_version_is_the_lowest_tested_one():
    lowest = PROJECT["project"]["requires-python"].removeprefix(">=")
    tried = (ROOT / "docs" / "reference" / "versions.md").read_text(encoding="utf-8")
    stated = [
        text.rpartition(" :: ")[2]
        for text in PROJECT["project"]["classifiers"]
        if text.startswith("Programming Language :: Python :: 3.")
    ]
    assert stated[0] == lowest
    assert all(f"| {version}." in tried for version in stated)


@pytest.mark.slow
@pytest.mark.parametrize("tagged", [True, False], ids=["of a tag", "without one"])
def test_sdist_and_wheel_are_built_and_pass_twine(tagged, tmp_path):
    """From a clone with a tag, or a plain folder; the wheel comes from the sdist, where no git is."""
    source = tmp_path / "source"
    kept = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=False)
    if kept.returncode:
        pytest.skip("not a checkout")
    for name in kept.stdout.splitlines():
        if (ROOT / name).is_file():
            (source / name).parent.mkdir(parents=True, exist_ok=True)
            (source / name).write_bytes((ROOT / name).read_bytes())
    if tagged:
        identity = ("-c", "user.name=x", "-c", "user.email=x@example.org")
        for words in (("init", "-q"), ("add", "-A"), (*identity, "commit", "-qm", "x"), ("tag", "v9.8.7")):
            subprocess.run(["git", *words], cwd=source, check=True)
    out = tmp_path / "dist"
    words = [sys.executable, "-m", "build", "--no-isolation", "--outdir", str(out), str(source)]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    names = sorted(path.name for path in out.iterdir())
    version = "9.8.7" if tagged else NEXT
    assert names == [f"twin_gait-{version}-py3-none-any.whl", f"twin_gait-{version}.tar.gz"]
    checked = [sys.executable, "-m", "twine", "check", "--strict", *map(str, out.iterdir())]
    done = subprocess.run(checked, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout
