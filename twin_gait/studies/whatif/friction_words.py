"""Paragraphs on the friction map, computed from its tables."""

from __future__ import annotations

import pandas as pd

from twin_gait.studies.loop_stability.loop_stability import Ending
from twin_gait.studies.whatif.friction_joint import DEAD_ZONE, Compensation, Law
from twin_gait.studies.whatif.friction_map import FrictionMap
from twin_gait.studies.whatif.words import count, cycles, from_to, paragraph

_MAP = """
A knee was pushed and let go on a spring {runs} times, its friction compensated at the measured velocity,
with filters that are {delays} ms late. With G below s, the ratio of true friction to model, {rest_below}
of {below} came to rest. With G above s {moving} of {above} did not: {cycles}, {runaways} runaways into a
stop. {late} The transition matrix of the linear loop at rest says growth or decay as it came in {agreed} of
{runs} cases. For s = {ratio:g} a joint without a spring keeps to G = {free} by that map and to {seen} in
the search, whose tests end before the slowest have died out, over all filters: G = s. A compensator that
shakes at G = 0.6 tells of a friction near 0.6 of its model.
"""
_LATE = "Those with G above s that rest are behind filters of {delays} ms."
_LIMITS = """
Where instability does not begin at G = s = {ratio:g}. A stiff spring behind a late filter: the torque
comes so late that it turns away from the velocity; at {spring:g} Nm/deg and {delay:g} ms the largest
resting G is {gain:.2f} (its matrix {linear:.2f}). The shape of the law: {shapes}. There the limit is the
least ratio of true friction to model among the speeds that the joint passes on its way to rest; over
{laws} searches simulation and ratio differ by {worst:.3f} in G at most. Load: where {share:.0%} of the
load rubs, {load:g} kg raise the limit to {loaded:.2f} (ratio {loaded_ratio:.2f}); what is tuned under
load is too strong without it.
"""
_WAYS = """
Alternatives. A dead zone of {zone:g} rad/s keeps rest stable but not motion: with G above s, {small_rest}
of {small} came to rest after a push within the zone, and {large_rest} of {large} after one of {push:g}
rad/s. At the velocity of a reference nothing is fed back, and {reference_rest} of {reference} came to
rest whatever G; but a hand that leads the joint is not helped. At G = {gain:g} with s = {ratio:g} the
hand does {work_measured:.0%} of its work without compensation, {work_zone:.0%} with the dead zone,
{work_reference:.0%} with the reference; led along a path by its own spring the joint errs by
{error_measured:.2f}°, {error_zone:.2f}° and {error_reference:.2f}° RMS, {error_none:.2f}° without
compensation.
"""


def friction_text(found: FrictionMap) -> tuple[str, ...]:
    """Paragraphs on the friction map.

    Args:
        found: The study.

    Returns:
        On the map, on where G = s does not hold, and on the alternatives.
    """
    return _map_text(found), _limits_text(found.thresholds), _ways_text(found)


def _map_text(found: FrictionMap) -> str:
    rows = found.map[found.map["compensation"] == Compensation.MEASURED]
    below, above = (rows[rows["gain"] < rows["friction_ratio"]], rows[rows["gain"] > rows["friction_ratio"]])
    still = above[above["ending"] == Ending.REST]
    agreed = (rows["growth_at_rest_per_s"] > 0.0) == (rows["ending"] != Ending.REST)
    limits = found.thresholds[found.thresholds["varied"] == "filter"]
    free = limits[limits["spring_Nm_per_deg"] == 0.0]
    return paragraph(
        _MAP,
        runs=len(rows),
        delays=", ".join(f"{value:g}" for value in sorted(rows["filter_delay_ms"].unique())),
        rest_below=count(below, Ending.REST),
        below=len(below),
        moving=len(above) - len(still),
        above=len(above),
        cycles=cycles(above),
        runaways=count(above, Ending.RUNAWAY),
        late=_LATE.format(delays=from_to(still["filter_delay_ms"])) if len(still) else "",
        agreed=int(agreed.sum()),
        free=from_to(free["linear_gain_at_rest"]),
        seen=from_to(free["largest_gain"]),
        ratio=free["friction_ratio"].iloc[0],
    )


def _limits_text(limits: pd.DataFrame) -> str:
    springs = limits[limits["varied"] == "filter"]
    latest = springs.sort_values(["spring_Nm_per_deg", "filter_delay_ms"]).iloc[-1]
    laws, loads = limits[limits["varied"] == "law"], limits[limits["varied"] == "load"]
    heaviest = loads.sort_values(["coulomb_per_load", "load_kg"]).iloc[-1]
    return paragraph(
        _LIMITS,
        ratio=latest["friction_ratio"],
        spring=latest["spring_Nm_per_deg"],
        delay=latest["filter_delay_ms"],
        gain=latest["largest_gain"],
        linear=latest["linear_gain_at_rest"],
        shapes=", ".join(
            f"{words} {_ends(laws[laws['law'] == law])}"
            for law, words in (
                (Law.NO_DIP, "a joint without the dip of table 3.1 rests up to"),
                (Law.DEEPER_DIP, "one with a deeper dip up to"),
            )
        ),
        laws=len(laws),
        worst=(laws["largest_gain"] - laws["least_torque_ratio"]).abs().max(),
        share=heaviest["coulomb_per_load"],
        load=heaviest["load_kg"],
        loaded=heaviest["largest_gain"],
        loaded_ratio=heaviest["least_torque_ratio"],
    )


def _ends(law: pd.DataFrame) -> str:
    """Gains after the gentlest and the strongest push, in words."""
    ends = law.sort_values("push_rad_per_s").iloc[[0, -1]]
    gains = " and ".join(f"{value:.2f}" for value in ends["largest_gain"])
    return (
        f"G = {gains} after pushes of {' and '.join(f'{value:g}' for value in ends['push_rad_per_s'])} rad/s"
    )


def _ways_text(found: FrictionMap) -> str:
    zone = found.map[found.map["compensation"] == Compensation.DEAD_ZONE]
    above = zone[zone["gain"] > zone["friction_ratio"]]
    pushes = sorted(above["push_rad_per_s"].unique())
    small, large = (above[above["push_rad_per_s"] == value] for value in pushes)
    reference = found.map[found.map["compensation"] == Compensation.REFERENCE]
    prices = found.prices
    ratio = float(prices["friction_ratio"].iloc[0])
    # The last gain below s.
    near = prices[prices["gain"] <= ratio].groupby("compensation").tail(1).set_index("compensation")
    work, error = near["hand_work_share"], near["path_error_deg"]
    return paragraph(
        _WAYS,
        zone=DEAD_ZONE,
        small_rest=count(small, Ending.REST),
        small=len(small),
        large_rest=count(large, Ending.REST),
        large=len(large),
        push=pushes[-1],
        reference_rest=count(reference, Ending.REST),
        reference=len(reference),
        gain=near["gain"].iloc[0],
        ratio=ratio,
        work_measured=work[Compensation.MEASURED],
        work_zone=work[Compensation.DEAD_ZONE],
        work_reference=work[Compensation.REFERENCE],
        error_measured=error[Compensation.MEASURED],
        error_zone=error[Compensation.DEAD_ZONE],
        error_reference=error[Compensation.REFERENCE],
        error_none=prices[prices["gain"] == 0.0]["path_error_deg"].iloc[0],
    )
