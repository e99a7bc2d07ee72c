"""Environments of Gymnasium for learning on simulated gait: ``import twin_gait.learn`` registers them.

>>> import gymnasium, twin_gait.learn  # doctest: +SKIP
>>> env = gymnasium.make("twin_gait/Treadmill-v0")  # doctest: +SKIP
>>> envs = gymnasium.make_vec("twin_gait/Treadmill-v0", 32, "vector_entry_point")  # doctest: +SKIP
"""

from twin_gait.learn.environment import GaitEnv as GaitEnv
from twin_gait.learn.environment import VectorGaitEnv as VectorGaitEnv
from twin_gait.learn.environment import register

for _name, _options in {
    "Treadmill": {"experiment": "treadmill"},
    "Overground": {"experiment": "overground"},
    "Gait": {},
}.items():
    register(f"twin_gait/{_name}-v0", _options)
