"""Environments of Gymnasium for learning on simulated gait: ``import twin_gait.learn`` registers them.

>>> import gymnasium, twin_gait.learn  # doctest: +SKIP
>>> env = gymnasium.make("twin_gait/Overground-v0")  # doctest: +SKIP
>>> envs = gymnasium.make_vec("twin_gait/Gait-v0", 32, "vector_entry_point")  # doctest: +SKIP
"""

from twin_gait.learn.environment import GaitEnv as GaitEnv
from twin_gait.learn.environment import VectorGaitEnv as VectorGaitEnv
from twin_gait.learn.environment import register

register("twin_gait/Gait-v0", {})
# Shipped policies and benchmark were made with the guided walk, which simulates faster than one in braces.
for _world, _preset in (("treadmill", "treadmill_guided"), ("overground", "overground")):
    register(f"twin_gait/{_world.capitalize()}-v0", {"experiment": _preset})
