"""A run as it was read from its directory."""

from collections.abc import Mapping
from typing import Any, NamedTuple

from twin_gait.simulation.run import Run


class StoredRun(NamedTuple):
    """Run that was read from its directory."""

    run: Run  # run as :func:`twin_gait.simulate` returned it
    summary: Mapping[str, Any]  # content of ``summary.json``
    name: str = ""  # name of its directory
