"""How numbers of a walk fade to others, and legs to the parameters of their phases."""

from typing import Any, NamedTuple

import numpy as np

from twin_gait.core.blending import BLEND_MINIMUM_JERK, blend, blend_share


class Fade(NamedTuple):
    """Numbers on their way to others by the minimum-jerk law; JSON takes it as it is."""

    start: list[Any]  # what they were, as nested lists
    target: list[Any]  # what they come to, likewise
    first: int  # first tick of the fade
    ticks: int  # its length; 0 for a change at once

    def write(self, tick: int, values: np.ndarray) -> bool:
        """Write what they are in a tick; True if they are not there yet. ``values`` are changed in place."""
        if tick - self.first + 1 >= self.ticks:
            values[...] = self.target
            return False
        share = blend_share((tick - self.first + 1) / self.ticks, BLEND_MINIMUM_JERK)
        values[...] = blend(np.array(self.start), np.array(self.target), share)  # type: ignore[arg-type]
        return True


def arrive(episode: np.void, chosen: np.ndarray) -> None:
    """Give the chosen legs the parameters of their phases; ``episode`` is changed in place."""
    controller = episode["controller"]
    joints = controller["joints"].reshape(len(chosen), -1)
    for leg, own, wanted in zip(controller["legs"], joints, chosen, strict=True):
        if wanted:
            own["blended"] = own["setpoints"][:, leg["phase"]]
            leg["gravity"] = leg["gravity_shares"][leg["phase"]]


def fade_anew(episode: np.void) -> None:
    """Let every leg fade from its present parameters; ``episode`` is changed in place."""
    joints, legs = episode["controller"]["joints"], episode["controller"]["legs"]
    joints["blend_start"], legs["gravity_start"] = joints["blended"], legs["gravity"]
