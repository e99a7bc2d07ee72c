"""Pages: what is filled in is escaped, nothing is loaded, and figures are turned dark with the page."""

from __future__ import annotations

import re

import pytest
from jinja2 import UndefinedError

from twin_gait.report.pages import TEMPLATES, _environment, render

PAGE = """{% extends "layout.html" %}{% from "parts.html" import picture %}
{% block body %}{{ picture(png, name) }}{% endblock %}"""


def page(**content: object) -> str:
    return _environment().from_string(PAGE).render(version="1", png=b"PNG", **content)


def test_what_is_filled_in_is_escaped_and_nothing_is_loaded() -> None:
    made = page(title="<b>&", subtitle="'\"<i>", name="<u>")
    assert "&lt;b&gt;&amp;" in made
    assert not any(text in made for text in ("<b>", "<i>", "<u>"))
    assert "default-src 'none'" in made
    addresses = re.findall(r'(?:src|srcset|href)="([^"]*)"', made)
    assert len(addresses) == 1 and all(item.startswith("data:image/png;base64,") for item in addresses)


def test_figures_are_turned_dark_with_the_page() -> None:
    dark = "@media screen and (prefers-color-scheme: dark) { img { filter: invert(1)"
    assert dark in page(title="", name="one")


def test_a_number_that_a_template_misses_is_an_error() -> None:
    with pytest.raises(UndefinedError, match="found_better"):
        render("tune.txt", {})


def test_every_page_has_the_one_layout() -> None:
    pages = {path.name for path in TEMPLATES.glob("*.html")} - {"layout.html", "parts.html"}
    assert pages == {"compare.html", "tune.html"}
    for name in pages:
        assert (TEMPLATES / name).read_text(encoding="utf-8").startswith('{% extends "layout.html" %}')
