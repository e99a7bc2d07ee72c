"""What the README says runs."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from twin_gait import load_experiment, simulate

README = (Path(__file__).parent.parent / "README.md").read_text(encoding="utf-8")


def test_the_fifteen_lines_run(tmp_path, monkeypatch):
    (code,) = re.findall(r"```python\n(.*?)```", README, flags=re.DOTALL)
    assert len(code.splitlines()) <= 16
    monkeypatch.chdir(tmp_path)
    exec(compile(code, "README.md", "exec"), {})
    assert (tmp_path / "stride.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("changes", [[], ["duration_s=6", "patient.mass_kg=80"]])
def test_the_wearer_walks_with_its_controller(changes):
    sessions = re.findall(r"```pycon\n(.*?)```", README, flags=re.DOTALL)
    session = next(text for text in sessions if "def " in text)
    code = "".join(line[4:] + "\n" for line in session.splitlines())
    names = {"simulate": simulate, "experiment": load_experiment("treadmill", changes).experiment}
    exec(compile(code, "README.md", "exec"), names)
    run = names["run"]
    assert run.status == "completed" and run.trip is None
    entries = [item.tick for item in run.switches if (item.side, item.target) == ("left", "early_stance")]
    assert len(entries) >= run.duration // 2.5  # a stride every two seconds or so


def test_pictures_and_files_that_it_links_exist():
    folder = Path(__file__).parent.parent
    for target in re.findall(r"\]\(([^)#]+)\)", README):
        if not target.startswith("http"):
            assert (folder / target).is_file(), target


def test_commands_that_it_names_exist():
    from twin_gait.cli.program import build_parser

    known = next(
        action.choices
        for action in build_parser()._actions
        if isinstance(getattr(action, "choices", None), dict)
    )
    named = set(re.findall(r"`twin-gait (\w+)", README))
    assert named <= set(known)
    assert set(known) <= named
