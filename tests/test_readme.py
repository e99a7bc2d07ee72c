"""What README, CONTRIBUTING and the pages say: code runs, commands parse, links lead somewhere."""

from __future__ import annotations

import re
import shlex
from functools import cache
from pathlib import Path

import pytest

from twin_gait.cli.program import ProgramParser, build_parser

ROOT = Path(__file__).parent.parent
# What a build of the site leaves among the pages.
GENERATED = {
    path
    for folder in ("_build", "gallery", "reference/api")
    for path in (ROOT / "docs" / folder).rglob("*.md")
}
WRITTEN = sorted(set((ROOT / "docs").rglob("*.md")) - GENERATED)
PAGES = {
    str(path.relative_to(ROOT)): path.read_text(encoding="utf-8")
    for path in (
        ROOT / "README.md",
        ROOT / "CONTRIBUTING.md",
        *sorted(set((ROOT / "docs").rglob("*.md")) - GENERATED),
    )
}
README = PAGES["README.md"]
# A fenced block, whose language may be left out.
BLOCK = re.compile(r"^```(\w*)\n(.*?)^```", flags=re.DOTALL | re.MULTILINE)
# Commands of a page that runs; what the shell makes of their output is not the program's.
CELL = re.compile(r"^```\{code-cell\}\n(?::.*\n)*%%bash\n(.*?)^```", flags=re.DOTALL | re.MULTILINE)


def test_the_readme_is_short():
    assert len(README.splitlines()) <= 150


def test_the_fifteen_lines_run(tmp_path, monkeypatch):
    (code,) = re.findall(r"```python\n(.*?)```", README, flags=re.DOTALL)
    assert len(code.splitlines()) <= 16
    monkeypatch.chdir(tmp_path)
    exec(compile(code, "README.md", "exec"), {})
    assert (tmp_path / "stride.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("page", PAGES)
def test_pictures_files_and_headings_that_are_linked_exist(page):
    folder = (ROOT / page).parent
    for target, anchor in re.findall(r"\]\(([^)#\s]*)(?:#([^)]+))?\)", PAGES[page]):
        if target.startswith("http"):
            continue
        path = folder / target if target else ROOT / page
        if any(
            part in target for part in ("gallery/", "api/")
        ):  # made by the build of the site, which is strict
            continue
        assert path.exists(), f"{page}: {target}"
        if anchor:
            words = path.read_text(encoding="utf-8")
            stub = re.fullmatch(r"The site has .*\]\((.*)\) in this place\.\n", words)
            if stub:
                words = (path.parent / stub[1]).read_text(encoding="utf-8")
            headings = re.findall(r"^#+ (.*)$", words, flags=re.MULTILINE)
            known = {re.sub(r"[^\w\- ]", "", text.lower()).replace(" ", "-") for text in headings}
            assert anchor in known, f"{page}: {target}#{anchor}"


def test_the_mutations_that_the_readme_counts_are_those_of_the_test_kit():
    found = re.findall(
        r"^\| (all|equivalent|missed) \|(.*)\|$", PAGES["docs/reference/test_kit.md"], flags=re.MULTILINE
    )
    rows = {name: [int(number) for number in re.findall(r"\d+", cells)] for name, cells in found}
    caught, made = sum(rows["all"][::2]), sum(rows["all"][1::2])
    proved, missed = sum(rows["equivalent"]), sum(rows["missed"])
    shown = re.sub(r"<!--.*?-->", "", README)
    assert f"{caught} of {made} caught, {proved} proved equivalent, {missed} missed" in shown


def test_every_page_is_in_a_table_of_contents():
    listed = {"docs/index.md"}
    for page, text in PAGES.items():
        for block in re.findall(r"^```\{toctree\}\n(.*?)^```", text, flags=re.DOTALL | re.MULTILINE):
            names = [line for line in block.split() if not line.startswith(":")]
            listed |= {str(Path(page).parent / f"{name}.md") for name in names}
    assert {page for page in PAGES if page.startswith("docs/")} <= listed


@cache
def parser() -> ProgramParser:
    return build_parser()


def known_commands() -> set[str]:
    return {name for commands in parser().groups.values() for name in commands}


@pytest.mark.parametrize("page", PAGES)
def test_commands_that_are_named_exist(page):
    assert set(re.findall(r"`twin-gait ([a-z]+)", PAGES[page])) <= known_commands()


def test_the_readme_names_every_command():
    assert set(re.findall(r"`twin-gait ([a-z]+)", README)) == known_commands()


def command_lines() -> list[tuple[str, str]]:
    """Commands in blocks, and those in the text that need nothing filled in."""
    found = []
    for page, text in PAGES.items():
        for language, block in BLOCK.findall(text):
            if language in ("", "sh"):
                lines = block.replace("\\\n", " ").splitlines()
                found += [(page, part.strip()) for line in lines for part in line.split("&&")]
        cells = "\n".join(CELL.findall(text)).replace("\\\n", " ").splitlines()
        found += [(page, re.split(r"[|;]", line)[0].strip()) for line in cells]
        found += [(page, line) for line in re.findall(r"`(twin-gait [^`]+)`", BLOCK.sub("", text))]
    return [(page, line) for page, line in found if line.startswith("twin-gait ")]


@pytest.mark.parametrize(("page", "line"), command_lines())
def test_command_lines_parse(page, line, capsys):
    words = shlex.split(re.sub(r"\s*>\s*\S+$", "", line.partition("#")[0]))[1:]
    if words == ["COMMAND", "--help"]:
        return
    placeholders = any(mark in line for mark in ("[", "…", "|"))
    # A command that is only named may lack what it needs; one with an option or in a block is whole.
    if placeholders or len(words) == 1 or words[:2] == ["sessions", words[-1]]:
        assert words[0] in known_commands() or words[0].startswith("--")
        return
    try:
        parser().parse_args(words)
    except SystemExit as leave:
        assert leave.code == 0, f"{page}: {line}: {capsys.readouterr().err}"
