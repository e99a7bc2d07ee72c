"""Pages: what is filled in is escaped, nothing is loaded, and figures are turned dark with the page."""

from __future__ import annotations

import re
from functools import partial
from pathlib import Path

from errors import raises
from jinja2 import UndefinedError
from matplotlib.figure import Figure

from twin_gait.report.canvas import write_figures_page
from twin_gait.report.pages import TEMPLATES, render


def test_template_values_are_escaped_and_nothing_external_is_loaded(tmp_path: Path) -> None:
    write_figures_page(
        tmp_path / "page.html",
        {"<u>": partial(Figure, figsize=(1.0, 1.0))},
        "<b>&",
        "'\"<i>",
        [("<th>",), ("<td>",)],
        {},
    )
    page = (tmp_path / "page.html").read_text()
    assert "&lt;b&gt;&amp;" in page and "&lt;th&gt;" in page
    assert not any(text in page for text in ("<b>", "<i>", "<u>", "<th><th>", "<td><td>"))
    assert "default-src 'none'" in page
    addresses = re.findall(r'(?:src|srcset|href)="([^"]*)"', page)
    assert len(addresses) == 1 and all(item.startswith("data:image/png;base64,") for item in addresses)


def test_figures_follow_the_dark_theme_of_the_page() -> None:
    content = {"title": "", "subtitle": "", "rows": [()], "pictures": {"one": b""}, "tables": {}}
    page = render("figures.html", content)
    assert "@media screen and (prefers-color-scheme: dark) { img { filter: invert(1)" in page


def test_a_missing_template_value_is_an_error() -> None:
    with raises(UndefinedError, "found_better"):
        render("tune.txt", {})


def test_every_page_has_the_one_layout() -> None:
    pages = {path.name for path in TEMPLATES.glob("*.html")} - {"layout.html", "parts.html"}
    assert pages == {"compare.html", "conditions.html", "tune.html", "figures.html", "session_report.html"}
    for name in pages:
        assert (TEMPLATES / name).read_text(encoding="utf-8").startswith('{% extends "layout.html" %}')
