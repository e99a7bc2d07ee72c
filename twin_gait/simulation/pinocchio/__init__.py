"""The engine in Python on Pinocchio's dynamics: the reference implementation beside the compiled one.

It shares the laws of :mod:`twin_gait.core` with it, not the dynamics, and its rooms mirror those of the
compiled loop in :mod:`twin_gait.simulation.episode`.
"""
