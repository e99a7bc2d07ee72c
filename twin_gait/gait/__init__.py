"""Phases, the gait table, its guards, and the state machine of a leg."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
