"""Test kit for gait tables.

    >>> from twin_gait.testing.cases import transition_tests
    >>> from twin_gait.configuration.gait_table_file import load_gait_table
    >>> tests = transition_tests(load_gait_table("treadmill"))
    >>> for test in tests:
    ...     test.run()

This package also contains the pytest plugin (:mod:`twin_gait.testing.plugin`), which every pytest loads;
names are therefore imported when they are first used.
"""
