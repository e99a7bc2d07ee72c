"""A guard reads the signal: it opens only while the shank leans forwards by more than two degrees."""

import numpy as np

from twin_gait import load_experiment, simulate
from twin_gait.gait.signals import signal_names

assert "shank.inclination_deg" in signal_names(["hip", "knee"]), (
    "another twin_gait is imported: pip install -e ."
)
guarded = """table={extends: treadmill_guided, transitions: [{from: early_stance, to: middle_stance,
    cause: leans, all: ["shank.inclination_deg > 2"]}]}"""
run = simulate(load_experiment("treadmill_guided", ["duration_s=6", guarded]).experiment)
leans = [switch for switch in run.switches if switch.cause == "leans"]
for switch in leans:
    hip, knee = (
        run.log[f"{switch.side}_{joint}_measured_angle_rad"][switch.tick] for joint in ("hip", "knee")
    )
    assert np.degrees(hip - knee) > 2.0, switch
assert {switch.side for switch in leans} == {"left", "right"}
