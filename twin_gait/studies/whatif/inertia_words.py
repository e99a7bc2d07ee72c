"""Paragraphs on inertia compensation, computed from the tables of the study."""

from __future__ import annotations

import pandas as pd

from twin_gait.studies.loop_stability.loop_stability import Ending
from twin_gait.studies.whatif.inertia import BUS_DELAY, UNDECIDED, InertiaStudy
from twin_gait.studies.whatif.inertia_map import Source
from twin_gait.studies.whatif.words import count, cycles, from_to, paragraph

_STABILITY = """
With a rigid gear a free joint is stable up to a share of {free} of its inertia, whatever the sensor and
its delay, as G = s is for friction; held by a hand, up to {held}. {compliance} Eigenvalues and linear
runs disagree in {misses} of {decided} decided cases. With true friction and its compensation {moving} of
{runs} joints do not come to rest: {cycles}{torque}, {runaways} runaways; {early} of them where the linear
loop decays.
"""
_COMPLIANCE = """
A compliant gear parts encoder and unit: the encoder, on the motor, keeps {motor}; a unit on the link
meets the resonance of the gear, and a free joint keeps {quick} with samples up to {bus:g} ms late, but
{worst:.2f} ({source}) with {late:g} ms.
"""
_NOISE = """
The price of a quick filter is noise. RMS of the torque at a share of {share:g}, over the mean delay of
the acceleration: {sources}. Behind the quickest filters the {noisiest} is noisiest, behind the slowest
the {quietest} is quietest. Linear theory meets the simulated noise within {worst:.0%}, and the inertia
that a hand feels at 1 Hz within {felt:.4f} of the joint's.
"""


def inertia_text(found: InertiaStudy) -> tuple[str, ...]:
    """Paragraphs on inertia compensation.

    Args:
        found: The study.

    Returns:
        On stability, and on noise.
    """
    return _stability_text(found), _noise_text(found.noise)


def _stability_text(found: InertiaStudy) -> str:
    rows, limits = found.stability, found.limits
    decided = rows[rows["growth_per_s"].abs() > UNDECIDED]
    moving = rows[rows["ending"] != Ending.REST]
    rigid = limits[limits["gear"] == "rigid"]
    return paragraph(
        _STABILITY,
        free=from_to(rigid[~rigid["held"]]["largest_share"]),
        held=from_to(rigid[rigid["held"]]["largest_share"]),
        compliance=_compliance_text(limits[(limits["gear"] == "compliant") & ~limits["held"]]),
        misses=int(((decided["growth_per_s"] > 0.0) != decided["linear_run_grows"]).sum()),
        decided=len(decided),
        moving=len(moving),
        runs=len(rows),
        cycles=cycles(rows),
        torque=_torque_text(moving),
        runaways=count(rows, Ending.RUNAWAY),
        early=int((moving["growth_per_s"] < 0.0).sum()),
    )


def _torque_text(moving: pd.DataFrame) -> str:
    """A joint may hardly move and still be shaken by all that the motor gives."""
    return f" whose torque swings by ±{from_to(moving['torque_amplitude_Nm'])} N m" if len(moving) else ""


def _compliance_text(limits: pd.DataFrame) -> str:
    if limits.empty:
        return ""
    link = limits[limits["source"] != Source.ENCODER]
    worst = link.sort_values("largest_share").iloc[0]
    return paragraph(
        _COMPLIANCE,
        motor=from_to(limits[limits["source"] == Source.ENCODER]["largest_share"]),
        quick=from_to(link[link["bus_delay_ms"] <= BUS_DELAY]["largest_share"]),
        bus=BUS_DELAY,
        worst=worst["largest_share"],
        source=worst["source"],
        late=worst["bus_delay_ms"],
    )


def _noise_text(noise: pd.DataFrame) -> str:
    share = noise["share"].median()
    rows = noise[(noise["noise_factor"] == 1.0) & (noise["share"] == share)]
    quick, slow = (
        rows[rows["filter_ms"] == end] for end in (rows["filter_ms"].min(), rows["filter_ms"].max())
    )
    return paragraph(
        _NOISE,
        share=share,
        sources="; ".join(_source_text(rows[rows["source"] == source]) for source in Source),
        noisiest=quick.sort_values("torque_noise_Nm")["source"].iloc[-1],
        quietest=slow.sort_values("torque_noise_Nm")["source"].iloc[0],
        worst=(noise["torque_noise_Nm"] / noise["linear_torque_noise_Nm"] - 1.0).abs().max(),
        felt=(noise["felt_inertia_share"] - noise["closed_felt_inertia_share"]).abs().max(),
    )


def _source_text(rows: pd.DataFrame) -> str:
    ordered = rows.sort_values("mean_delay_ms")
    pairs = zip(ordered["torque_noise_Nm"], ordered["mean_delay_ms"], strict=True)
    points = [f"{noise:.2g} N m at {delay:.1f} ms" for noise, delay in pairs]
    return f"{ordered['source'].iloc[0]} {points[0]}, {points[-1]}"
