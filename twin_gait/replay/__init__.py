"""Offline replay of recorded walks: the decisions of a gait table on measurements from a log."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
