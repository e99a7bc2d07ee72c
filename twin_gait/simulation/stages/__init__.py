"""The rooms of a tick: ordinary functions of the record of an episode, the tick first.

Compiled with a generated kernel they are the engine, uncompiled on Pinocchio the reference implementation;
see :mod:`twin_gait.simulation.binding`.

What is done to one episode stands in a loop over ``lanes(e)``, so that the same text runs many in lockstep;
:mod:`twin_gait.simulation.lanes` says what makes such a loop vectors. What is rare, or different in each,
stands in a loop over ``each(e)``.
"""
