"""Picture and page of a comparison of controllers."""

from __future__ import annotations

import html
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from twin_gait.palette import BLUE, BLUISH_GREEN, GREY, ORANGE, REDDISH_PURPLE, SKY_BLUE, VERMILLION
from twin_gait.report.html_page import html_page, paragraphs, picture_source

COLOURS = (BLUE, VERMILLION, BLUISH_GREEN, ORANGE, REDDISH_PURPLE, SKY_BLUE, GREY)
_INK = {False: "#222222", True: "#dddddd"}
_FRONT = {False: "#000000", True: "#ffffff"}


@dataclass(frozen=True, eq=False)
class Walked:
    """One controller that walked, for the picture.

    Attributes:
        title: Its name.
        colour: Its colour.
        cycles: Mean angle in [deg] over the cycle by panel, shape ``(101,)`` each.
        bars: Numbers by label.
    """

    title: str
    colour: str
    cycles: Mapping[str, np.ndarray]
    bars: Mapping[str, float]


def draw_comparison(
    walked: Sequence[Walked], reference: Mapping[str, np.ndarray], *, dark: bool = False
) -> Figure:
    """Draw joint angles over the cycle, and bars.

    Args:
        walked: The controllers that walked.
        reference: Healthy angles in [deg] by panel.
        dark: For a dark page.

    Returns:
        The figure.
    """
    ink = _INK[dark]
    figure = Figure(figsize=(13.0, 3.1), layout="constrained")
    panels = np.asarray(figure.subplots(1, len(reference) + 2)).flatten().tolist()
    for axes, (name, healthy) in zip(panels, reference.items(), strict=False):
        _draw_cycle(axes, name, healthy, walked, _FRONT[dark])
    labels = list(walked[0].bars) if walked else []
    for axes, label in zip(panels[len(reference) :], labels, strict=False):
        _draw_bars(axes, label, walked)
    for axes in panels:
        _style(axes, ink)
    handles, names = panels[0].get_legend_handles_labels()
    if names:
        figure.legend(
            handles,
            names,
            loc="outside lower center",
            ncols=len(names),
            frameon=False,
            labelcolor=ink,
            fontsize=8,
        )
    return figure


def _draw_cycle(axes: Axes, name: str, healthy: np.ndarray, walked: Sequence[Walked], front: str) -> None:
    percent = np.linspace(0.0, 100.0, len(healthy))
    for item in walked:
        axes.plot(percent, item.cycles[name], color=item.colour, linewidth=1.5, label=item.title)
    axes.plot(percent, healthy, color=front, linestyle=":", linewidth=1.5, label="healthy, same speed")
    axes.set_title(f"{name} [°]", fontsize=9)
    axes.set_xlabel("stride [%]", fontsize=8)
    axes.set_xlim(0.0, 100.0)


def _draw_bars(axes: Axes, label: str, walked: Sequence[Walked]) -> None:
    places = np.arange(len(walked))
    axes.bar(places, [item.bars[label] for item in walked], color=[item.colour for item in walked])
    axes.set_xticks([])
    axes.set_title(label, fontsize=9)


def _style(axes: Axes, ink: str) -> None:
    axes.patch.set_alpha(0.0)
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color(ink)
    axes.tick_params(colors=ink, labelsize=8)
    axes.title.set_color(ink)
    axes.xaxis.label.set_color(ink)


_STYLE = """
:root { color-scheme: light dark; --ink: #222; --ground: #fff; --quiet: #666; --line: #ddd; --band: #f3f5f7; }
@media (prefers-color-scheme: dark) {
  :root { --ink: #ddd; --ground: #16181b; --quiet: #999; --line: #3a3d42; --band: #212429; } }
body { font: 14px/1.45 system-ui, sans-serif; color: var(--ink); background: var(--ground);
  max-width: 1180px; margin: 1.5em auto; padding: 0 1em; }
h1 { font-size: 1.5em; margin: 0 0 .1em; }
.who { color: var(--quiet); margin: 0 0 .8em; }
p { max-width: 72em; margin: .5em 0; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; width: 100%; font-size: 12.5px; font-variant-numeric: tabular-nums; }
th, td { padding: 2px 8px; text-align: right; border-bottom: 1px solid var(--line); vertical-align: bottom; }
td { white-space: nowrap; }
th:first-child, td:first-child { text-align: left; }
tr.group td { font-weight: 600; background: var(--band); }
td.none { color: var(--quiet); }
img { width: 100%; margin-top: .8em; }
dl { font-size: 12px; columns: 2; column-gap: 2.5em; }
dt { font-weight: 600; break-after: avoid; } dd { margin: 0 0 .4em; color: var(--quiet); }
footer { color: var(--quiet); font-size: 12px; margin-top: 1em; }
@page { size: A4 landscape; margin: 7mm; }
@media print {
  :root { --ink: #000; --ground: #fff; --quiet: #444; --line: #ccc; --band: #eee; }
  body { zoom: 0.9; font-size: 7.6pt; line-height: 1.25; margin: 0; padding: 0; max-width: none; }
  p { margin: .25em 0; max-width: none; } h1 { font-size: 12pt; } .who { margin-bottom: .3em; }
  table { font-size: 6.6pt; line-height: 1.15; } th, td { padding: 0 5px; }
  img { max-height: 38mm; object-fit: contain; margin-top: .2em; }
  dl { font-size: 5.6pt; line-height: 1.15; columns: 5; column-gap: 1.5em; margin: .2em 0; }
  dd { margin-bottom: .1em; }
  footer { margin-top: .2em; font-size: 6pt; } }
"""

_BODY = """<p class="who">{subtitle}</p>
{paragraphs}
<div class="wide"><table>
<thead><tr><th></th>{heads}</tr></thead>
<tbody>
{rows}
</tbody>
</table></div>
<picture><source media="screen and (prefers-color-scheme: dark)" srcset="{dark}">
<img alt="Joint angles over the stride and bars" src="{light}"></picture>
<dl>
{meanings}
</dl>"""


def comparison_page(
    *,
    title: str,
    subtitle: str,
    text: Sequence[str],
    controllers: Sequence[tuple[str, str]],
    rows: Sequence[tuple[str, str, str, Sequence[str]]],
    pictures: tuple[bytes, bytes],
    version: str,
) -> str:
    """The report, which needs no other file and prints on one page.

    Args:
        title: Of the page.
        subtitle: Who walks, how fast, how long.
        text: Paragraphs.
        controllers: Title and explanation of each.
        rows: Group, label, meaning and one text per controller.
        pictures: PNG for a light and for a dark page.
        version: Of this package.

    Returns:
        HTML.
    """
    light, dark = (picture_source(item) for item in pictures)
    body = _BODY.format(
        subtitle=html.escape(subtitle),
        paragraphs=paragraphs(text),
        heads="".join(
            f'<th title="{html.escape(why)}">{html.escape(name)}</th>' for name, why in controllers
        ),
        rows="\n".join(_table_lines(rows, len(controllers))),
        light=light,
        dark=dark,
        meanings="\n".join(_meanings(controllers, rows)),
    )
    return html_page(title, body, version=version, style=_STYLE)


def _table_lines(rows: Sequence[tuple[str, str, str, Sequence[str]]], width: int) -> list[str]:
    lines, last = [], ""
    for group, label, meaning, texts in rows:
        if group != last:
            lines.append(f'<tr class="group"><td colspan="{width + 1}">{html.escape(group)}</td></tr>')
            last = group
        cells = "".join(_cell(text) for text in texts)
        lines.append(f'<tr><td title="{html.escape(meaning)}">{html.escape(label)}</td>{cells}</tr>')
    return lines


def _cell(text: str) -> str:
    quiet = ' class="none"' if text == "–" else ""
    return f"<td{quiet}>{html.escape(text)}</td>"


def _meanings(
    controllers: Sequence[tuple[str, str]], rows: Sequence[tuple[str, str, str, Sequence[str]]]
) -> list[str]:
    """Every word explained once; labels that mean the same share their explanation."""
    names: dict[str, list[str]] = {}
    for name, meaning in [*controllers, *((label, meaning) for _, label, meaning, _ in rows)]:
        names.setdefault(meaning, []).append(name)
    return [
        f"<dt>{html.escape(' · '.join(labels))}</dt><dd>{html.escape(meaning)}</dd>"
        for meaning, labels in names.items()
    ]
