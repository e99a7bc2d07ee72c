"""The rooms of a tick: ordinary functions of the record of an episode, the tick first.

Compiled with a generated kernel they are the engine, uncompiled on Pinocchio the reference implementation;
see :mod:`twin_gait.simulation.binding`.
"""
