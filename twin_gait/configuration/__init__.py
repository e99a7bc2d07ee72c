"""Reading and writing of gait tables, experiments and people as YAML, with validation on reading."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
