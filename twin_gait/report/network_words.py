"""What a bus has carried, in a summary and for people: a table of its frames."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from twin_gait.simulation.traffic import BusTraffic

HEAD = ("mean age [ms]", "oldest [ms]", "lost [%]", "slowest [ms]")


def summary_of_traffic(traffic: BusTraffic) -> dict[str, Any]:
    """What a bus has carried, for a summary; times in [s]."""
    frames = {
        frame.name: {
            "mean_age_s": frame.mean_age,
            "oldest_s": frame.oldest,
            "sent": frame.sent,
            "lost": frame.lost,
            "replaced": frame.replaced,
            "destroyed": frame.destroyed,
            "worst_response_s": frame.worst_response,
        }
        for frame in traffic.frames
    }
    totals = {key: sum(frame[key] for frame in frames.values()) for key in ("sent", "lost", "destroyed")}
    return {"bus_load": traffic.load, **totals, "bus_offs": dict(traffic.bus_offs), "frames": frames}


def table_of_network(summary: Mapping[str, Any]) -> list[tuple[str, ...]]:
    """How old what the gait controller and the boards went by was, and what the bus took for it.

    Returns a head and a row for each frame; nothing without a bus.
    """
    network = summary.get("network")
    if not network:
        return []
    rows: list[tuple[str, ...]] = [(f"bus in use for {network['bus_load']:.0%}", *HEAD)]
    for name, frame in network["frames"].items():
        mean, oldest, slowest = (1e3 * frame[key] for key in ("mean_age_s", "oldest_s", "worst_response_s"))
        lost = 100.0 * frame["lost"] / max(frame["sent"], 1)
        label = name.replace("_", " ")
        rows.append((label, f"{mean:.2f}", f"{oldest:.0f}", f"{lost:.1f}", f"{slowest:.3f}"))
    return rows
