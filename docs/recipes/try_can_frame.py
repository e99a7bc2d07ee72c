"""Frames of a walk carry the new message, and other tools decode it."""

import cantools

from twin_gait import load_experiment, simulate
from twin_gait.export.can import network_messages, run_frames
from twin_gait.network.dbc import PACKAGED_DBC, find_dbc

experiment = load_experiment("treadmill_guided", ["duration_s=1"]).experiment
run = simulate(experiment)
message = cantools.database.load_file(find_dbc(PACKAGED_DBC)).get_message_by_name("support")
found = [
    frame for frame in run_frames(run, network_messages(experiment)) if frame.identifier == message.frame_id
]
assert found
for frame in found:
    tick = round(frame.time * 1000)
    assert abs(message.decode(frame.data)["force"] - run.log["support_force_N"][tick]) <= 0.25
