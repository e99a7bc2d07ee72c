"""Many runs: batches, sweeps, tuning, comparison, faults, and the job runner under all of them.

What is offered here is imported when it is first asked for.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
