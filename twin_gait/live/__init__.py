"""Live sessions: a gait that is simulated in real time and can be changed while it runs."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
