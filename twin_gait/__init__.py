"""Gait simulation of the TWIN leg exoskeleton.

    >>> from twin_gait import load_experiment, simulate  # doctest: +SKIP
    >>> run = simulate(load_experiment("treadmill").experiment)  # doctest: +SKIP
    >>> run.log["left_knee_angle_rad"].max()  # doctest: +SKIP
    >>> run.save("runs/walk")  # doctest: +SKIP
    >>> run.plot("gait_cycle").savefig("cycle.png")  # doctest: +SKIP

Not a medical device.
"""

import lazy_loader

try:
    from twin_gait._version import __version__  # type: ignore[import-not-found, unused-ignore]  # by the build
except ImportError:  # a checkout without a build
    __version__ = "0.1.0.dev0"

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
__all__ += ["__version__"]
