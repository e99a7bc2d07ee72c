"""A guard reads the signal: it opens only while the trunk pitches forwards."""

from twin_gait import load_experiment, simulate
from twin_gait.gait.signals import DEVICE_NAMES

assert "trunk.velocity_deg_per_s" in DEVICE_NAMES, "another twin_gait is imported: pip install -e ."
guarded = """table={extends: overground, transitions: [{from: early_stance, to: middle_stance, cause: leans,
    all: ["trunk.velocity_deg_per_s > 1"]}]}"""
run = simulate(load_experiment("overground", ["duration_s=4", guarded]).experiment)
leans = [switch.tick for switch in run.switches if switch.cause == "leans"]
rate = run.log["trunk_pitch_velocity_rad_per_s"].to_numpy()
assert leans and all(rate[tick] > 0.017 for tick in leans), leans
