"""The spots are drawn, and lie under the loaded foot, between heel and toe."""

from twin_gait import load_experiment, simulate
from twin_gait.viewer.commands import CommandBuffer
from twin_gait.viewer.motion import read_motion
from twin_gait.viewer.scene import build_scene

experiment = load_experiment("treadmill_guided", ["duration_s=1"]).experiment
model = experiment.build_world().model
motion = read_motion(simulate(experiment).log, model)
scene = build_scene(CommandBuffer(), model)
state = scene.state_at(motion, 0)
heel, toe = (scene.figure.frame_point(motion.q[0], f"left_{part}") for part in ("heel", "toe"))
place = state["/meshcat/surroundings/left_pressure", "position"]
assert heel[0] <= place[0] <= toe[0]
