"""Numbers of the thesis compared with ours: claims of claims.yaml, and a verdict on each."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml
from gallery import ScriptOptions
from matplotlib.figure import Figure

from twin_gait.report.canvas import save

RESOLUTION = 75  # of figures in dots per inch
CLAIMS = Path(__file__).with_name("claims.yaml")
OUT_OF_BAND, CALIBRATED = "OUT OF BAND", "calibrated"
AGREES = "in band, as the thesis's number"
UNSTATED = "in band; the thesis prints no number"
CONTRADICTED = "in band; the thesis's number is not"
GIVEN_BACK = "given back"  # the bench was built from the thesis's number
# Names under which results.json counts the verdicts on numbers that are in their bands.
COUNTED = {"agrees": AGREES, "unstated": UNSTATED, "contradicted": CONTRADICTED, "given_back": GIVEN_BACK}

Numbers = Mapping[str, Any]


def claims_of(script: str) -> dict[str, list[dict[str, Any]]]:
    """Return the claims that a script checks, by figure."""
    return yaml.safe_load(CLAIMS.read_text(encoding="utf-8"))[script]


def number_of(entry: float | str | None, numbers: Numbers) -> float | None:
    """Return a number that the claim states, or the computed number that it names."""
    return numbers[entry] if isinstance(entry, str) else entry


def verdict_of(claim: Mapping[str, Any], numbers: Numbers) -> str:
    """Return the verdict on a number: whether it is in its band, ends included, and the thesis's as well.

    A calibrated number has no band and is not judged.
    """
    if "band" not in claim:
        return CALIBRATED
    low, high = (number_of(end, numbers) for end in claim["band"])
    low, high = (-math.inf if low is None else low), (math.inf if high is None else high)
    ours, thesis = numbers[claim["ours"]], number_of(claim.get("thesis"), numbers)
    if not (math.isfinite(ours) and low <= ours <= high):
        return OUT_OF_BAND
    if claim.get("given_back"):
        return GIVEN_BACK
    if thesis is None:
        return UNSTATED
    return AGREES if low <= thesis <= high else CONTRADICTED


def number_text(value: float | None, unit: str = "1") -> str:
    """Format a number with four digits, unit and a true minus sign; a dash for no number."""
    if value is None:
        return "–"
    return f"{value:.4g}".replace("-", "−") + ("" if unit == "1" else f" {unit}")


def band_text(claim: Mapping[str, Any], numbers: Numbers) -> str:
    """Format a band in words, for example ``at least 1``."""
    low, high = (number_of(end, numbers) for end in claim.get("band", (None, None)))
    if low is None and high is None:
        return "–"
    if low is None:
        return f"at most {number_text(high)}"
    return f"at least {number_text(low)}" if high is None else f"{number_text(low)} … {number_text(high)}"


def label_of(figure: str) -> str:
    """Return ``fig-3.2`` for the key ``fig_3_2``, because keys on a page cannot contain a dot."""
    kind, _, number = figure.partition("_")
    return f"{kind}-{number.replace('_', '.')}"


def rows_of(script: str, found: Mapping[str, Numbers]) -> Iterator[dict[str, str]]:
    """Return a row for each claim about the drawn figures."""
    for figure, claims in claims_of(script).items():
        for claim in claims if figure in found else ():
            numbers, unit = found[figure], claim.get("unit", "1")
            yield {
                "figure": label_of(figure),
                "claim": claim["claim"],
                "thesis": number_text(number_of(claim.get("thesis"), numbers), unit),
                "ours": number_text(numbers[claim["ours"]], unit),
                "band": band_text(claim, numbers),
                "verdict": verdict_of(claim, numbers),
            }


@dataclass
class Answers:
    """Numbers and figures of a script.

    Attributes:
        script: Name of the script in claims.yaml.
        form: Form with the folder of the results.
        found: Numbers by figure.
    """

    script: str
    form: ScriptOptions
    found: dict[str, Numbers] = field(default_factory=dict)

    def add(self, figure: str, numbers: Numbers, picture: Figure | None = None) -> None:
        """Store the numbers for the claims on a figure, and the reproduced figure."""
        self.found[figure] = dict(numbers)
        if picture is not None:
            save(picture, self.form.out / f"{figure}.png", resolution=RESOLUTION)

    def conclude(self) -> None:
        """Write results.json with the table of claims; exit with 1 if a number is out of its band."""
        rows = list(rows_of(self.script, self.found))
        judged = [row for row in rows if row["verdict"] != CALIBRATED]
        failed = [row for row in judged if row["verdict"] == OUT_OF_BAND]
        held = len(judged) - len(failed)
        verdicts = [row["verdict"] for row in rows]
        counts = {name: verdicts.count(verdict) for name, verdict in COUNTED.items()}
        self.form.write_results(
            {"judged": len(judged), "in_band": held, **counts, "claims": rows, **self.found}
        )
        print(f"{held} of {len(judged)} numbers in their bands; see {self.form.out}")
        for row in failed:
            print("out of band:", ", ".join(f"{name} {text}" for name, text in row.items()))
        if failed:
            sys.exit(1)
