"""Identification of joint friction from logs and from series of velocity and torque."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
