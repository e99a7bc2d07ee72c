"""The joint test bench: one motor, one gear, a rigid link with a weight, a stop (thesis, section 2.2.1).

Sources: *thesis* is what it prints; *data sheet* is maxon's EC 90 flat 323772 (24 V); *from memory* was not
found again; *assumption* has no source, with the reason beside it.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
