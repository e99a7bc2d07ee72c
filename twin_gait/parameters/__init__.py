"""Frozen parameters in SI units, checked on creation.

Every number that a user can change is a field of one of these dataclasses, documented with its source.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
