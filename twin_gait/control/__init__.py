"""The controller of a joint, behind one interface, and what its monitor says."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
