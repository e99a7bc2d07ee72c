"""Pictures of a run, and the canvas for further pictures; matplotlib is imported when one is drawn."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
