"""The laws, each once: pure typed functions on plain numbers and arrays.

No law imports anything but :mod:`math` and :mod:`numpy`, keeps state, reads a clock or draws
a random number. The reference engine calls these functions as plain Python, and the compiled engine compiles
the very same ones, so there is no second copy of a law to drift. Exponentials, sines and cosines are those of
:mod:`twin_gait.core.elementary`, squares are plain products: NumPy's and the C library's differ in the last
bit from one version and machine to the next.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
