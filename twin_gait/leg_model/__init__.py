"""Rigid bodies: the URDF, the wearer's segments, and the one room that knows Pinocchio."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
