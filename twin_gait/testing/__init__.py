"""A test kit for anyone's gait table.

    >>> from twin_gait.testing import transition_tests
    >>> from twin_gait.configuration.gait_table_file import load_gait_table
    >>> tests = transition_tests(load_gait_table("treadmill"))
    >>> for test in tests:
    ...     test.run()

The pytest plugin (:mod:`twin_gait.testing.plugin`) lives here too and is loaded by every pytest, so
names are imported when they are first used.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
