"""Storage of runs: run directory, summary, and reading them back.

The names of this package are imported at their first use, because the imports for pictures and tables take
longer than the simulation of a walk.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
