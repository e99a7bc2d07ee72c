"""Static checks of a gait table: what can go wrong, found without a run.

A rule is a function ``(case: CheckCase) -> list[Finding]``; its name is the id of its findings and the first
line of its docstring says what it finds. Each module lists its rules in ``RULES``. Public are the pieces of
the rules on stability: the closed-loop transition matrix and the friction laws in it; and what the bus has to carry.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
