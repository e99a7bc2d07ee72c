"""Frozen parameters in SI units, checked when they are made.

Every number that a user can change lives in one of these dataclasses, with its source beside it.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
