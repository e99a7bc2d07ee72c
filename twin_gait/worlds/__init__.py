"""Worlds of the leg model (bench leg, treadmill, floor), and the test bench of a single joint."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

# A module of the same name would be found instead of the function.
from twin_gait.worlds.bench_joint import bench_joint as bench_joint  # noqa: E402
