"""What a reproduction leaves behind: page, numbers and pictures in a folder."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from twin_gait import __version__
from twin_gait.files import finite_or_none, write_atomically
from twin_gait.report.reproduction import ShownClaim, ShownFigure, page_text
from twin_gait.runs.folders import FolderKind
from twin_gait.simulation.run import RunStatus
from twin_gait.studies.reproduction.claim import Claim
from twin_gait.studies.reproduction.running import Made, ReproductionResult

DOCUMENT_FILE, PAGE_FILE = "reproduction.json", "reproduction.html"
REPRODUCTION = FolderKind("a reproduction", DOCUMENT_FILE)
FIGURES_FOLDER = "figures"
SCHEMA_VERSION = 1
IN_BAND, OUT_OF_BAND, NOT_JUDGED = "in its band", "out of its band", "not judged"
CONTRADICTS = "in its band; the thesis's is not"


def verdict_of(claim: Claim) -> str:
    """What is said of a claim: in its band, out of it, or not judged."""
    if claim.holds is None:
        return NOT_JUDGED
    if not claim.holds:
        return OUT_OF_BAND
    return CONTRADICTS if claim.contradicts else IN_BAND


def write_reproduction(result: ReproductionResult, folder: Path) -> None:
    """Write figures, numbers and page.

    Args:
        result: The reproduction.
        folder: An existing, empty folder.
    """
    (folder / FIGURES_FOLDER).mkdir()
    for item in result.made:
        write_atomically(folder / FIGURES_FOLDER / f"{item.key}.png", item.picture)
    text = json.dumps(reproduction_document(result), indent=2, ensure_ascii=False, allow_nan=False)
    write_atomically(folder / DOCUMENT_FILE, f"{text}\n")
    page = page_text(
        [_shown(item) for item in result.made],
        version=__version__,
        seed=result.seed,
        complete=result.status is RunStatus.COMPLETED,
    )
    write_atomically(folder / PAGE_FILE, page)


def _shown(item: Made) -> ShownFigure:
    claims = tuple(
        ShownClaim(
            name=claim.name,
            thesis=claim.thesis,
            ours=claim.ours,
            unit=claim.unit,
            kind=str(claim.kind),
            low=claim.low,
            high=claim.high,
            reason=claim.reason,
            source=claim.source,
            holds=claim.holds,
            contradicts=claim.contradicts,
            verdict=verdict_of(claim),
        )
        for claim in item.claims
    )
    return ShownFigure(item.key, item.title, item.text, claims, item.readings, item.picture)


def reproduction_document(result: ReproductionResult) -> dict[str, Any]:
    """The reproduction as plain numbers.

    Args:
        result: The reproduction.

    Returns:
        Figures in the order of the thesis with all claims; numbers that are not finite are null.
    """
    claims = [claim for item in result.made for claim in item.claims]
    return {
        "schema_version": SCHEMA_VERSION,
        "synthetic": True,
        "twin_gait_version": __version__,
        "seed": result.seed,
        "status": str(result.status),
        "predicted": sum(claim.holds is not None for claim in claims),
        "in_band": sum(claim.holds is True for claim in claims),
        "out_of_band": [f"{key}: {claim.name}" for key, claim in result.failed],
        "figures": [
            {
                "key": item.key,
                "title": item.title,
                "picture": f"{FIGURES_FOLDER}/{item.key}.png",
                "text": item.text,
                "claims": [_claim_entry(claim) for claim in item.claims],
                "readings": list(item.readings),
            }
            for item in result.made
        ],
    }


def _claim_entry(claim: Claim) -> dict[str, Any]:
    return {
        "name": claim.name,
        "thesis": claim.thesis,
        "ours": finite_or_none(claim.ours),
        "unit": claim.unit,
        "kind": str(claim.kind),
        "band": [finite_or_none(claim.low), finite_or_none(claim.high)],
        "reason": claim.reason,
        "source": claim.source,
        "verdict": verdict_of(claim),
    }
