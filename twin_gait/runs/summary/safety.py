"""What a run's summary says of the safety monitor."""

from __future__ import annotations

from typing import Any

from twin_gait.simulation.run import Run


def safety_summary(run: Run) -> dict[str, Any]:
    """Sum up what the monitor did.

    Args:
        run: The run.

    Returns:
        Whether there was a monitor, whether, why, where and when in [s] it tripped, and the faults of the
        experiment in their notation.
    """
    trip = run.trip
    return {
        "watched": run.experiment.control.safety.enabled,
        "tripped": trip is not None,
        "cause": None if trip is None else str(trip.cause),
        "place": None if trip is None else trip.place,
        "time_s": None if trip is None else trip.time,
        "faults": " ".join(str(item) for item in run.experiment.faults),
    }
