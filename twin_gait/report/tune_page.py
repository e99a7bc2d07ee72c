"""The page of a tuning's report: one HTML file, words and tables computed from what came out."""

from __future__ import annotations

import html
from collections.abc import Mapping, Sequence
from typing import Any

from twin_gait.palette import BLUISH_GREEN, VERMILLION
from twin_gait.report.html_page import PLAIN_STYLE, html_page, paragraphs, picture_source
from twin_gait.report.tune import Outcome, amount, name_of

_STYLE = f"""{PLAIN_STYLE}
td.better {{ color: {BLUISH_GREEN}; }} td.traded {{ color: {VERMILLION}; font-weight: 600; }}
"""


def page(outcome: Outcome, pictures: Mapping[str, bytes]) -> str:
    """The report as one page that needs no other file.

    Args:
        outcome: Content of ``tune.json``.
        pictures: From :func:`draw_pictures`.

    Returns:
        HTML.
    """
    sections = [
        paragraphs(summary(outcome)),
        _section("Gait before and after", _gait_words(outcome), pictures["gait"]),
        _section("Named parts", _parts_words(outcome), pictures["parts"]) + _parts_table(outcome["parts"]),
        _section("The robust set", _robust_words(outcome), None) + _robust_table(outcome["robust_set"]),
        _section("As the patient departs", _departure_words(), pictures["departures"]),
    ]
    if "screening" in pictures:
        sections.append(
            _section("What matters, and what does not", screening_words(outcome), pictures["screening"])
        )
    sections.append(_section("Convergence", convergence_words(outcome), pictures["convergence"]))
    sections.append(_parameter_table(outcome["parameters"]))
    title = f"A gait table tuned to {outcome['wearer']}"
    return html_page(title, "\n".join(sections), version=outcome["version"], style=_STYLE)


def summary(outcome: Outcome) -> list[str]:
    """What came out, in sentences.

    Args:
        outcome: Content of ``tune.json``.

    Returns:
        Paragraphs.
    """
    if not outcome["found_better"]:
        return [
            f"The search found no table that walks the robust set better than {outcome['table_before']}; "
            "table.yaml is that table."
        ]
    robust = outcome["robust_set"]
    falls = {which: sum(row[which]["fell"] for row in robust) for which in ("before", "after")}
    cost = outcome["cost"]["robust"]
    return [
        f"Before: the table {outcome['table_before']}. The search began with {outcome['began_with']}. "
        f"Reference: {outcome['reference']}. {_verdicts(outcome['parts'])}",
        f"Over the robust set of {len(robust)} cases the tuned table falls in {falls['after']} "
        f"(before: {falls['before']}) and costs {cost['after']:.2f} (before: {cost['before']:.2f}).",
    ]


def _verdicts(parts: Sequence[Mapping[str, Any]]) -> str:
    sentences = []
    for verdict, words in (
        ("better", "Better"),
        ("traded", "Traded for it, so worse"),
        ("same", "Unchanged"),
    ):
        named = [_change(part) for part in parts if part["verdict"] == verdict]
        if named:
            sentences.append(f"{words}: {', '.join(named)}.")
    return " ".join(sentences)


def _change(part: Mapping[str, Any]) -> str:
    if part["verdict"] == "same":
        return f"{part['title']} ({amount(part['after'], part['unit'])})"
    before, after = amount(part["before"], ""), amount(part["after"], part["unit"])
    return f"{part['title']} {before} → {after}"


def _gait_words(outcome: Outcome) -> str:
    return (
        f"Mean strides from foot contact to foot contact, without the first two, in a walk of "
        f"{outcome['walk_s']:g} s at {outcome['belt_speed_m_per_s']:.2f} m/s. The reference is "
        f"{outcome['reference']}."
    )


def _parts_words(outcome: Outcome) -> str:
    excess = outcome["excess"]
    return (
        "Of the two legs the larger value counts. A walk costs the sum of weight × (value / goal)² over the "
        f"parts, {outcome['worst_cost']:g} at most; a fall costs more than any walk. In "
        f"the search an error beyond {excess['aim']:.0%} of its goal costs {excess['weight']:g} × (value / "
        f"goal − {excess['aim']:g})² more, in the walk that the table is tuned for. An error is the "
        "root mean square difference to the reference; a second contact is another landing of the foot right "
        "after it landed; a scuff is a touch of the ground in swing."
    )


def _robust_words(outcome: Outcome) -> str:
    check = outcome["check"]
    return (
        "The same table with another wearer, plant or sensor than it was tuned for. With another mass the "
        "device still reckons with the nominal one. "
        f"twin-gait check finds {check['errors']} errors and {check['warnings']} warnings in the tuned "
        "table; what was accepted (waived) in the table before is not carried over."
    )


def _departure_words() -> str:
    return "One quantity at a time; a table is good for the person it was tuned for, and for what lies near."


def screening_words(outcome: Outcome) -> str:
    """What the screening says.

    Args:
        outcome: Content of ``tune.json``.

    Returns:
        Sentences.
    """
    effects = outcome["screening"]
    kept = [item for item in effects if item["kept"]]
    least = sorted((item for item in effects if not item["kept"]), key=lambda item: item["mu_star"])
    total = sum(item["mu_star"] for item in effects) or 1.0
    share = 100.0 * sum(item["mu_star"] for item in kept) / total
    words = (
        f"Elementary effects (Morris) of {len(effects)} numbers about the start, on the logarithm of the "
        f"cost. {len(kept)} of them make up {share:.0f} % of all effects and were searched; the others "
        "stayed as they were."
    )
    if least:
        words += f" Least of all matter: {', '.join(name_of(item['name']) for item in least[:5])}."
    return words


def convergence_words(outcome: Outcome) -> str:
    """What the search took and gained.

    Args:
        outcome: Content of ``tune.json``.

    Returns:
        Sentences.
    """
    effort, best = outcome["effort"], outcome["convergence"]["best"]
    return (
        f"CMA-ES, seed {effort['seed']}: {effort['candidates']} candidates in "
        f"{effort['generations']} generations; "
        f"the best cost went from {best[0]:.2f} to {best[-1]:.2f}. It took "
        f"{effort['elapsed_s'] / 60.0:.1f} minutes."
    )


def _parts_table(parts: Sequence[Mapping[str, Any]]) -> str:
    rows = [
        (
            [
                part["title"],
                part["unit"],
                amount(part["before"], ""),
                amount(part["after"], ""),
                amount(part["goal"], ""),
                f"{part['weight']:g}",
                f"{part['cost_before']:.2f}",
                f"{part['cost_after']:.2f}",
                part["verdict"],
            ],
            part["verdict"],
        )
        for part in parts
    ]
    heads = ["part", "unit", "before", "after", "goal", "weight", "cost before", "cost after", ""]
    return _table(heads, rows)


def _robust_table(robust: Sequence[Mapping[str, Any]]) -> str:
    rows = []
    for row in robust:
        cells = [row["case"]]
        for name in ("hip_error_deg", "knee_error_deg", "saturated_pct"):
            cells += [_ending(row[which], name) for which in ("before", "after")]
        cells += [f"{row[which]['cost']:.2f}" for which in ("before", "after")]
        verdict = "better" if row["after"]["cost"] < row["before"]["cost"] else "traded"
        rows.append((cells, "" if row["after"]["cost"] == row["before"]["cost"] else verdict))
    measures = ("hip error [°]", "knee error [°]", "at a limit [%]", "cost")
    heads = ["case", *(f"{name} {which}" for name in measures for which in ("before", "after"))]
    return _table(heads, rows)


def _ending(walk: Mapping[str, Any], name: str) -> str:
    return "falls" if walk["fell"] else amount(walk[name], "")


def _parameter_table(parameters: Sequence[Mapping[str, Any]]) -> str:
    rows = [
        (
            [name_of(item["name"]), item["unit"], f"{item['start']:g}", f"{item['tuned']:g}", *_bounds(item)],
            "",
        )
        for item in parameters
    ]
    table = _table(["number of the table", "unit", "before", "after", "searched from", "to"], rows)
    return f"<details><summary>All {len(rows)} numbers</summary>\n{table}\n</details>"


def _bounds(item: Mapping[str, Any]) -> list[str]:
    return [f"{item['lower']:g}", f"{item['upper']:g}"] if item["searched"] else ["stayed", ""]


def _table(heads: Sequence[str], rows: Sequence[tuple[Sequence[str], str]]) -> str:
    """Rows of cells; the last cell of a row wears its verdict as a class."""
    head = "".join(f"<th>{html.escape(item)}</th>" for item in heads)
    lines = [f"<table>\n<tr>{head}</tr>"]
    for cells, verdict in rows:
        inner = "".join(f"<td>{html.escape(item)}</td>" for item in cells[:-1])
        lines.append(f'<tr>{inner}<td class="{verdict}">{html.escape(cells[-1])}</td></tr>')
    return "\n".join([*lines, "</table>"])


def _section(title: str, words: str, picture: bytes | None) -> str:
    parts = [f"<section>\n<h2>{html.escape(title)}</h2>", paragraphs([words])]
    if picture is not None:
        parts.append(f'<img alt="{html.escape(title)}" src="{picture_source(picture)}">')
    return "\n".join([*parts, "</section>"])
