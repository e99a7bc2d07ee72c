"""Falls of the campaign as their logs tell them."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from twin_gait.studies.campaign import SETTINGS_FILE, Protocol
from twin_gait.studies.reproduction.shared import campaign_logs
from twin_gait.vocabulary import JointName


@dataclass(frozen=True, eq=False)
class Fall:
    """A fall of the campaign as its log tells it, up to the stop.

    Attributes:
        settings: Line of ``campaign.json`` on the test.
        time: In [s], shape ``(n,)``.
        angle: In [rad], shape ``(n,)``.
        velocity: As logged, in [rad] / [s], shape ``(n,)``.
        duty: As a share of full duty, shape ``(n,)``.
    """

    settings: Mapping[str, Any]
    time: np.ndarray
    angle: np.ndarray
    velocity: np.ndarray
    duty: np.ndarray

    @property
    def gain(self) -> float:
        """K."""
        return float(self.settings["K"])

    @property
    def amplitude(self) -> float:
        """A in counts."""
        return float(self.settings["A_counts"])


def falls_of(folder: Path, joint: JointName, mass: float, seed: int) -> list[Fall]:
    """Falls of one weight.

    Args:
        folder: Shared by the recipes of one reproduction.
        joint: Knee or hip.
        mass: In [kg].
        seed: Of the campaign.

    Returns:
        Nine falls in the order of the protocol.
    """
    directory = campaign_logs(folder, joint, Protocol.DROP, seed)[0].parent
    tests = json.loads((directory / SETTINGS_FILE).read_text(encoding="utf-8"))["tests"]
    return [_fall(directory, test) for test in tests if test["mass_kg"] == mass]


def _fall(directory: Path, test: Mapping[str, Any]) -> Fall:
    log = pd.read_csv(directory / test["file"], comment="#")
    if test["stop_s"] is not None:
        log = log[log["time_s"] <= test["stop_s"]]
    names = ("time_s", "position_rad", "velocity_rad_per_s", "duty")
    return Fall(test, *(log[name].to_numpy() for name in names))
