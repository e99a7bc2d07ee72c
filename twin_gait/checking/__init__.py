"""Static checks of a gait table: what can go wrong, found without a run.

A rule is a function ``(case: CheckCase) -> list[Finding]``; its name is the id of its findings and the first
line of its docstring says what it finds. Each module lists its rules in ``RULES``.
"""
