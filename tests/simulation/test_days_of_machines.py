"""Days under the modes of ReWalk and Ekso: rising, walking, stopping and sitting down."""

from __future__ import annotations

import numpy as np
import pytest

from twin_gait import load_experiment, simulate
from twin_gait.control.supervisor import NO_REQUEST

THERAPIST = ", ".join(f"step@{14.2 + 1.3 * number:.1f}s" for number in range(29))
# Settings, modes in which a step is commanded, distance in [m] and number of steps.
DAYS = {
    "rewalk": (
        (
            "modes=rewalk",
            "requests=[sit_to_stand@0.5s, walk@17s, stand@64s, stand_to_sit@72s]",
            "duration_s=87",
        ),
        ("step", "sitting", 9.4, 34),
    ),
    "ekso, weight": (
        ("modes=ekso", "requests=[stand@0.5s, pro_step@14s, stop@53s, sit@61s]"),
        ("shifted_step", "sitting", 12.5, 37),
    ),
    "ekso, therapist": (
        ("modes=ekso", f"requests=[stand@0.5s, first_step@14s, {THERAPIST}, stop@53s, sit@61s]"),
        ("therapist_step", "sitting", 8.0, 30),
    ),
}


@pytest.mark.slow  # compiles the loop of the floor
@pytest.mark.parametrize("name", DAYS)
def test_a_day_from_chair_to_chair(name):
    """The numbers are those of docs/background/modes.md."""
    settings, (stepping, seated, distance, steps) = DAYS[name]
    run = simulate(load_experiment("day", settings).experiment)
    assert run.verdict.outcome == "walked" and run.trip is None
    log, modes = run.log, run.experiment.modes
    assert modes is not None and not log["rejected"].ne(NO_REQUEST).any()
    codes = log["mode"].to_numpy(dtype=int)
    entered = [modes.phase_names[code] for code in codes[np.flatnonzero(np.diff(codes)) + 1]]
    lifts = [item for item in run.switches if item.target in ("swing_flexion", "closing_swing_flexion")]
    assert len(lifts) == steps and modes.phase_names[codes[-1]] == seated
    assert entered.count(stepping) >= steps - 1  # the last one closes the legs without a command
    assert round(float(np.ptp(log["pelvis_forward_m"])), 1) == distance
    assert log["seat_force_N"].iloc[-1] > 500.0
