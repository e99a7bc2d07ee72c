"""Recorded walks through the gait state machine, offline: what would this table have done?"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
