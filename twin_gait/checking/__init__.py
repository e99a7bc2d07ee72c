"""Static checks of a gait table: they find mistakes without a simulation.

A rule is a function ``(case: CheckCase) -> list[Finding]``. Its name is the id of its findings, and the first
line of its docstring says which mistake it finds. Each module lists its rules in ``RULES``. The public names
of this package are the parts of the stability rules, which are the closed-loop transition matrix and the
friction laws in it, and the function that computes the traffic on a CAN bus.
"""
