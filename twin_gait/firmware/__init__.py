"""The controller as C, printed from the functions of the simulation, and the processors that run it."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
