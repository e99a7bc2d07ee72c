"""The worlds that the leg lives in, bench leg and treadmill, and the bench of a single joint."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

# A module of the same name would be found in its place.
from twin_gait.worlds.bench_joint import bench_joint as bench_joint  # noqa: E402
