"""Studies of many runs: batches, sweeps, tuning, comparison, faults, and the job runner that they share.

Public names are imported when they are first used.
"""
