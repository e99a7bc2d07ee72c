"""Studies of many runs: batches, sweeps, tuning, comparison, faults, and the job runner that they share.

Public names are imported when they are first used.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
