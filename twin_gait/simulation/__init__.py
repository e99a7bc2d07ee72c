"""Simulation of an experiment, or of one joint on its bench; it accesses no files except the code cache."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
