"""Experiment: one frozen value that contains everything a run needs, and its conversion to models."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
