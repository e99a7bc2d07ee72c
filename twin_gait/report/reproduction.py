"""The page of a reproduction: the thesis's numbers and ours side by side, in one file without network."""

from __future__ import annotations

import math
from collections.abc import Sequence
from html import escape
from typing import NamedTuple

from twin_gait.palette import BLUE, BLUISH_GREEN, GREY, ORANGE, SKY_BLUE, VERMILLION
from twin_gait.report.html_page import POLICY, picture_source

TITLE = "The thesis, made again"
_DIGITS = 4


class ShownClaim(NamedTuple):
    """What the page shows of a claim.

    Attributes:
        name: What is compared.
        thesis: The thesis's number, or None.
        ours: Ours; NaN for none.
        unit: Of both; ``1`` for a ratio.
        kind: ``predicted`` or ``calibrated``.
        low: Lower end of the band.
        high: Upper end.
        reason: Why the band is as wide as it is.
        source: Where the thesis says so.
        holds: Whether ours is in the band; None if it is not judged.
        contradicts: Whether ours is in the band and the thesis's is not.
        verdict: In words.
    """

    name: str
    thesis: float | None
    ours: float
    unit: str
    kind: str
    low: float
    high: float
    reason: str
    source: str
    holds: bool | None
    contradicts: bool
    verdict: str


class ShownFigure(NamedTuple):
    """What the page shows of a figure.

    Attributes:
        key: As in ``--only``.
        title: What it shows.
        text: A paragraph.
        claims: Numbers side by side.
        readings: Where the thesis contradicts itself.
        picture: PNG.
    """

    key: str
    title: str
    text: str
    claims: tuple[ShownClaim, ...]
    readings: tuple[str, ...]
    picture: bytes


def page_text(figures: Sequence[ShownFigure], *, version: str, seed: int, complete: bool) -> str:
    """Write the page.

    Args:
        figures: In the order of the thesis.
        version: Of the program.
        seed: Of everything that chance decided.
        complete: False for a reproduction that was interrupted.

    Returns:
        HTML that needs no other file.
    """
    parts = [
        _head(),
        f"<header><h1>{TITLE}</h1>",
        f"<p>{_introduction(version, seed)}</p>",
        "" if complete else "<p class='warning'>Interrupted: only the figures below were made.</p>",
        _tiles(figures),
        "</header>",
        _contents(figures),
        *(_section(figure) for figure in figures),
        "<footer>Simulation, not a medical device. Every log behind this page is synthetic.</footer>",
        "</main></body></html>\n",
    ]
    return "\n".join(part for part in parts if part)


def _introduction(version: str, seed: int) -> str:
    return (
        "Figures and tables of the thesis on the joints of the TWIN exoskeleton (friction compensation and "
        "impedance control on one-joint and two-joint benches), made again on simulated benches by "
        f"twin_gait {escape(version)}, seed {seed}. <em>Predicted</em>: nothing in the program was set to "
        "get the number; it is judged by a band that has its reason beside it. <em>Calibrated</em>: a "
        "parameter was set to get it, so it proves nothing. Where the thesis's own number lies outside a "
        "band that ours is in, the two disagree, and the readings below the table say why."
    )


def _head() -> str:
    return (
        "<!DOCTYPE html>\n<html lang='en'><head><meta charset='utf-8'>"
        "<meta name='viewport' content='width=device-width, initial-scale=1'>"
        f'<meta http-equiv="Content-Security-Policy" content="{POLICY}">'
        f"<title>{TITLE}</title><style>{_STYLE}</style></head><body><main>"
    )


def _tiles(figures: Sequence[ShownFigure]) -> str:
    claims = [claim for figure in figures for claim in figure.claims]
    judged = [claim for claim in claims if claim.holds is not None]
    counts = (
        ("good", sum(bool(claim.holds) for claim in judged), f"of {len(judged)} predicted in their bands"),
        ("bad", sum(not claim.holds for claim in judged), "out of their bands"),
        ("doubt", sum(claim.contradicts for claim in judged), "where the thesis's number is outside"),
        ("plain", len(claims) - len(judged), "calibrated, not judged"),
    )
    tiles = (f"<li class='{name}'><b>{number}</b> {words}</li>" for name, number, words in counts)
    return f"<ul class='tiles'>{''.join(tiles)}</ul>"


def _contents(figures: Sequence[ShownFigure]) -> str:
    entries = (
        f"<li><a href='#{_anchor(figure)}'>{escape(figure.key)}</a> {escape(figure.title)} "
        f"{_marks(figure)}</li>"
        for figure in figures
    )
    return f"<nav><ol>{''.join(entries)}</ol></nav>"


def _anchor(figure: ShownFigure) -> str:
    return escape(figure.key, quote=True)


def _marks(figure: ShownFigure) -> str:
    """One dot for each claim."""
    dots = (
        f"<i class='dot {_look(claim)}' title='{escape(f'{claim.name}: {claim.verdict}', quote=True)}'></i>"
        for claim in figure.claims
    )
    return f"<span class='dots'>{''.join(dots)}</span>"


def _look(claim: ShownClaim) -> str:
    """Class of a claim's colours."""
    if claim.holds is None:
        return "plain"
    if not claim.holds:
        return "bad"
    return "doubt" if claim.contradicts else "good"


def _section(figure: ShownFigure) -> str:
    readings = "".join(f"<li>{escape(reading)}</li>" for reading in figure.readings)
    box = f"<div class='readings'><h3>Readings</h3><ul>{readings}</ul></div>" if readings else ""
    return (
        f"<section id='{_anchor(figure)}'><h2><span>{escape(figure.key)}</span> {escape(figure.title)}</h2>"
        f"<img alt='{escape(figure.title, quote=True)}' src='{picture_source(figure.picture)}'>"
        f"<p>{escape(figure.text)}</p>{_table(figure.claims)}{box}</section>"
    )


def _table(claims: Sequence[ShownClaim]) -> str:
    if not claims:
        return ""
    heads = ("", "thesis", "ours", "band", "", "verdict")
    cells = "".join(f"<th>{head}</th>" for head in heads)
    # Neighbours that share a reason have it once, below the last of them.
    following = [*(claim.reason for claim in claims[1:]), None]
    rows = (
        _row(claim) + ("" if claim.reason == after else _reason_row(claim))
        for claim, after in zip(claims, following, strict=True)
    )
    return f"<table><thead><tr>{cells}</tr></thead><tbody>{''.join(rows)}</tbody></table>"


def _row(claim: ShownClaim) -> str:
    unit = "" if claim.unit == "1" else f" {escape(claim.unit)}"
    thesis = "–" if claim.thesis is None else number_text(claim.thesis) + unit
    look = _look(claim)
    band = "–" if claim.holds is None else band_text(claim.low, claim.high)
    return (
        f"<tr class='{look}'><th scope='row'>{escape(claim.name)}<small>{escape(claim.source)}</small></th>"
        f"<td data-label='thesis'>{thesis}</td>"
        f"<td data-label='ours'><b>{number_text(claim.ours)}{unit}</b></td>"
        f"<td data-label='band'>{band}</td>"
        f"<td data-label='kind'>{escape(claim.kind)}</td>"
        f"<td data-label='verdict'><i class='dot {look}'></i> {escape(claim.verdict)}</td></tr>"
    )


def _reason_row(claim: ShownClaim) -> str:
    return f"<tr class='reason'><td colspan='6'>{escape(claim.reason)}</td></tr>"


def band_text(low: float, high: float) -> str:
    """A band in words.

    Args:
        low: Lower end, not finite for none.
        high: Upper end, likewise.

    Returns:
        For example ``at least 1``.
    """
    if not math.isfinite(low):
        return f"at most {number_text(high)}"
    if not math.isfinite(high):
        return f"at least {number_text(low)}"
    return f"{number_text(low)} … {number_text(high)}"


def number_text(value: float) -> str:
    """A number as the page prints it: four digits, a true minus sign.

    Args:
        value: The number; NaN for none.

    Returns:
        The text.
    """
    if not math.isfinite(value):
        return "none"
    return f"{value:.{_DIGITS}g}".replace("-", "−")


_STYLE = f"""
:root {{ color-scheme: light dark; --ink: #1b2430; --soft: #5b6673; --page: #ffffff; --card: #f5f7f9;
  --line: #d9dee4; --good: {BLUISH_GREEN}; --bad: {VERMILLION}; --doubt: {ORANGE}; --plain: {GREY};
  --link: {BLUE}; }}
@media (prefers-color-scheme: dark) {{ :root {{ --ink: #e8ecf1; --soft: #a3adb9; --page: #14181d;
  --card: #1e242b; --line: #343c46; --link: {SKY_BLUE}; }} }}
* {{ box-sizing: border-box; }}
body {{ margin: 0; background: var(--page); color: var(--ink); font: 16px/1.5 system-ui, sans-serif; }}
main {{ max-width: 62rem; margin: 0 auto; padding: 1.5rem 1rem 3rem; }}
h1 {{ margin: 0 0 .5rem; font-size: 1.9rem; }}
h2 {{ margin: 0 0 .8rem; font-size: 1.25rem; }}
h2 span {{ color: var(--soft); font-weight: 400; margin-right: .4em; }}
h3 {{ margin: 0; font-size: 1rem; }}
a {{ color: var(--link); }}
ul.tiles {{ list-style: none; display: flex; flex-wrap: wrap; gap: .7rem; margin: 1rem 0; padding: 0; }}
.tiles li {{ flex: 1 1 11rem; background: var(--card); border-left: 5px solid; padding: .6rem .9rem;
  font-size: .9rem; }}
.tiles b {{ display: block; font-size: 1.7rem; line-height: 1.2; }}
.tiles .good {{ border-color: var(--good); }} .tiles .bad {{ border-color: var(--bad); }}
.tiles .doubt {{ border-color: var(--doubt); }} .tiles .plain {{ border-color: var(--plain); }}
nav ol {{ list-style: none; padding: 0; columns: 20rem 2; column-gap: 2rem; font-size: .93rem; }}
nav li {{ break-inside: avoid; padding: .12rem 0; }}
nav a {{ display: inline-block; min-width: 5.2em; }}
.dots {{ white-space: nowrap; }}
.dot {{ display: inline-block; width: .62em; height: .62em; border-radius: 50%; margin-right: .15em; }}
.dot.good {{ background: var(--good); }} .dot.doubt {{ background: var(--doubt); }}
.dot.bad {{ background: var(--bad); border-radius: 0; transform: rotate(45deg); }}
.dot.plain {{ border: 2px solid var(--plain); }}
section {{ border-top: 1px solid var(--line); padding: 1.6rem 0 .8rem; }}
img {{ display: block; max-width: 100%; height: auto; background: #ffffff; padding: .5rem;
  border-radius: 6px; }}
table {{ border-collapse: collapse; width: 100%; font-size: .88rem; margin: .8rem 0; }}
thead th {{ text-align: left; font-weight: 400; color: var(--soft); border-bottom: 1px solid var(--line); }}
th, td {{ padding: .35rem .5rem; vertical-align: top; text-align: left; }}
th[scope] {{ font-weight: 600; width: 33%; }}
th small {{ display: block; font-weight: 400; color: var(--soft); }}
tr.bad td, tr.bad th {{ background: color-mix(in srgb, var(--bad) 14%, transparent); }}
.reason td {{ padding-top: 0; color: var(--soft); border-bottom: 1px solid var(--line); }}
.readings {{ border-left: 5px solid var(--doubt); background: var(--card); padding: .7rem 1rem; }}
.readings ul {{ margin: .3rem 0 0; padding-left: 1.1rem; }}
.warning {{ color: var(--bad); font-weight: 600; }}
footer {{ border-top: 1px solid var(--line); color: var(--soft); font-size: .85rem; padding-top: 1rem; }}
@media (max-width: 40rem) {{
  thead {{ display: none; }}
  tr, td, th {{ display: block; width: auto; }}
  th[scope] {{ width: auto; padding-bottom: 0; }}
  td {{ padding: .05rem .5rem; }}
  td[data-label]::before {{ content: attr(data-label) ": "; color: var(--soft); }}
  .reason td {{ padding-bottom: .6rem; }}
}}
@media print {{
  :root {{ color-scheme: light; --ink: #000000; --soft: #444444; --page: #ffffff; --card: #f5f7f9;
    --line: #bbbbbb; --link: {BLUE}; }}
  body {{ font-size: 10.5pt; }} main {{ max-width: none; padding: 0; }}
  img, tr, .readings, .tiles li {{ break-inside: avoid; }}
  h2 {{ break-after: avoid; }}
  .dot, .tiles li, .readings {{ print-color-adjust: exact; -webkit-print-color-adjust: exact; }}
}}
"""
