"""The page of the documentation on the reproduction, made again at will from its numbers.

``twin-gait reproduce --out DIR`` writes the numbers,
``python -m twin_gait.studies.reproduction.docs_page DIR docs`` page and pictures.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from twin_gait.exceptions import RunDirectoryError
from twin_gait.files import write_atomically
from twin_gait.report.reproduction import band_text, number_text
from twin_gait.studies.reproduction.writing import DOCUMENT_FILE, FIGURES_FOLDER

PAGE, PICTURE = "reproduction.md", "reproduction_{key}.png"
PICTURES = ("fig-3.2", "table-3.1", "fig-3.7")
_TEXT = """# The thesis, made again

`twin-gait reproduce --out DIR` makes the figures and tables of the thesis again on the simulated benches
and puts its numbers beside ours: `reproduction.html` (one file, no network, light and dark, printable),
`reproduction.json` and the pictures. `--only fig-3.7 table-3.1` makes some, `--list` names all. It takes
about a minute on two cores and exits with 1 if a predicted number leaves its band.

A number is **predicted** if nothing in the program was set to get it; each has a band with a reason from
physics or statistics, and only these are judged. A number is **calibrated** if a parameter was set to get
it: it proves nothing and is shown for completeness. [bench.md](bench.md) says which parameters were chosen,
and for what; how the falls of appendix B go is among them. Where the thesis prints no number but states an
order or a sign, the band is that order. Where its own number lies outside a band that ours is in, the two
contradict each other; that is printed, and not counted as a failure of either.

The friction of the simulated benches is that of table 3.1. That identification gives it back is therefore a
statement about campaign and processing, not about the device.

Below: seed {seed}, {in_band} of {predicted} predicted numbers in their bands.

## What it shows

{pictures}

## Numbers

{table}

## Readings

Where the thesis contradicts itself, or its text and physics part: the reading as printed, and the other
one.

{readings}
"""
_CAPTIONS = {
    "fig-3.2": "Figure 3.2 again: the same simulated falls, processed as the thesis does it and without "
    "delay. The dispersion that the thesis puts down to its data comes from the average, which lets the "
    "velocity lag behind current and load.",
    "table-3.1": "Table 3.1 again: 95 % intervals of the four parameters by campaign and processing; dashed, "
    "the friction of the bench.",
    "fig-3.7": "Figure 3.7 again, with what the thesis could not measure: the loop of the hand beside that "
    "of the motor.",
}


def write_page(source: Path, folder: Path) -> None:
    """Write page and pictures.

    Args:
        source: Folder of a whole reproduction.
        folder: An existing folder.

    Raises:
        RunDirectoryError: If the source is no reproduction.
    """
    try:
        document = json.loads((source / DOCUMENT_FILE).read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise RunDirectoryError(f"{source}: not a reproduction: it has no {DOCUMENT_FILE}") from error
    write_atomically(folder / PAGE, page_text(document))
    made = {item["key"] for item in document["figures"]}
    for key in PICTURES:
        if key in made:
            picture = (source / FIGURES_FOLDER / f"{key}.png").read_bytes()
            write_atomically(folder / PICTURE.format(key=key), picture)


def page_text(document: Mapping[str, Any]) -> str:
    """Text of the page.

    Args:
        document: Content of ``reproduction.json``.

    Returns:
        Markdown.
    """
    figures = {item["key"]: item for item in document["figures"]}
    pictures = (
        f"![{figures[key]['title']}]({PICTURE.format(key=key)})\n\n*{_CAPTIONS[key]}*"
        for key in PICTURES
        if key in figures
    )
    return _TEXT.format(
        seed=document["seed"],
        in_band=document["in_band"],
        predicted=document["predicted"],
        pictures="\n\n".join(pictures),
        table="\n".join(_table(document)),
        readings="\n".join(_readings(document)),
    )


def _table(document: Mapping[str, Any]) -> Iterator[str]:
    yield "| figure | number | thesis | ours | band | |"
    yield "| --- | --- | --- | --- | --- | --- |"
    for item in document["figures"]:
        for claim in item["claims"]:
            unit = "" if claim["unit"] == "1" else f" {claim['unit']}"
            thesis = "–" if claim["thesis"] is None else number_text(claim["thesis"]) + unit
            judged = claim["kind"] == "predicted"
            cells = (
                item["key"],
                claim["name"],
                thesis,
                number_text(_number(claim["ours"])) + unit,
                band_text(*map(_number, claim["band"])) if judged else "–",
                claim["verdict"] if judged else "calibrated",
            )
            yield f"| {' | '.join(cell.replace('|', '∣') for cell in cells)} |"


def _number(value: float | None) -> float:
    return float("nan") if value is None else value


def _readings(document: Mapping[str, Any]) -> Iterator[str]:
    for item in document["figures"]:
        for reading in item["readings"]:
            yield f"- **{item['key']}**: {reading}"


if __name__ == "__main__":
    write_page(Path(sys.argv[1]), Path(sys.argv[2]))
