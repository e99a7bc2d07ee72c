"""The preset runs in the new world, both legs step, and the schema knows its keys."""

from twin_gait import load_experiment, presets, simulate
from twin_gait.configuration.schema import json_schema

assert "frame" in presets(), "another twin_gait is imported: pip install -e ."
run = simulate(load_experiment("frame", ["duration_s=6", "scenario.resistance_Nms_per_rad=2"]).experiment)
assert {switch.side for switch in run.switches} == {"left", "right"}
assert "resistance_Nms_per_rad" in str(json_schema("experiment"))
