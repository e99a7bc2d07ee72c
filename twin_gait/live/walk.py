"""A stepped run as the live loop walks it: settings fade in, and the belt waits with a leg that waits."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from twin_gait.core.guards import Comparison
from twin_gait.live.stepping import SteppedRun

BELT_TICKS = 200  # in which the belt stops for a leg that waits, and starts again


class LiveWalk:
    """Advances a run and lets settings fade in.

    Attributes:
        run: The run.
    """

    def __init__(self, run: SteppedRun) -> None:
        """Begin with the settings of the run's own problem."""
        self.run = run
        world = run.problem.world
        self._belt_speed: float | None = None if world.contact is None else world.belt.cruise
        self._belt_waits = False

    def advance(self, ticks: int) -> np.ndarray:
        """Run some ticks; the belt stands while a leg waits for its step, else it would carry it away."""
        waits = bool(self.run.waiting())
        if waits != self._belt_waits and self._belt_speed is not None:
            self._belt_waits = waits
            self.run.fade("belt_speed", 0.0 if waits else self._belt_speed, BELT_TICKS)
        return self.run.advance(ticks)

    def restart(self) -> None:
        """Go back to tick 0 with the present settings."""
        self.run.restart()
        self._belt_waits = False
        if self._belt_speed is not None:
            self.run.fade("belt_speed", self._belt_speed, 0)

    def set(self, numbers: Mapping[str, Any]) -> None:
        """Let new settings fade in."""
        run = self.run
        run.set_phase_rows(np.array(numbers["phase_rows"]))
        run.set_comparisons([Comparison(**entries) for entries in numbers["comparisons"]])
        run.fade("target_torque", np.array(numbers["target_torque"]))
        if numbers["support_force"] is not None:
            run.fade("support_force", numbers["support_force"])
        if numbers["belt_speed"] is not None:
            self._belt_speed = numbers["belt_speed"]
            if not self._belt_waits:
                run.fade("belt_speed", numbers["belt_speed"])
        run.watch_phases(numbers["watching"])
        if numbers["held_phase"] != run.held_phase:
            run.hold_phase(numbers["held_phase"])

    def moment(self) -> dict[str, Any]:
        """The present moment, from which another walk of the same experiment can go on."""
        return {"run": self.run.moment(), "belt_speed": self._belt_speed, "belt_waits": self._belt_waits}

    def go_on_from(self, moment: Mapping[str, Any]) -> None:
        """Take over a moment of another walk of the same experiment."""
        self.run.go_on_from(moment["run"])
        self._belt_speed, self._belt_waits = moment["belt_speed"], moment["belt_waits"]
