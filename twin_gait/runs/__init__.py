"""What a run leaves on the disk: its directory, its summary, and how it is read again.

What is offered here is imported when it is first asked for: pictures and tables take longer than a walk to
simulate.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
