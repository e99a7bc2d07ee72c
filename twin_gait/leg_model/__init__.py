"""Rigid-body model of the legs: URDF, segments of the wearer, and the interface to Pinocchio."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
