"""What a page says to the simulation and what it hears back, as plain values.

Everything that comes from a page is JSON text and becomes one of two messages, or a refusal. Everything that
goes to a page is a mapping with a ``kind``:

* ``state``: the panel: all controls and actions with ranges, units and present values;
* ``frame``: one moment of the walk, some thirty times a second; the newest is the one that counts;
* ``event``: what became of a message, or what the simulation did by itself; none of them is dropped.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
