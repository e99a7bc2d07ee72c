"""The controller of the legs, behind one interface, and the trips of the safety monitor."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
