"""Steps of a tick: ordinary functions of the record of an episode, or of a joint, leg, sole or limb of it.

:mod:`twin_gait.simulation.schedule` has their order. Compiled with a generated kernel they are the engine,
uncompiled on Pinocchio the reference implementation; see :mod:`twin_gait.simulation.binding`.

A step works on one episode and does not know how many run in lockstep. Only the integration (:mod:`.motion`)
and the evaluation of the guards (:mod:`.phases`) have loops over the episodes of a block of their own;
:mod:`twin_gait.simulation.lanes` says what makes such a loop vector code.
"""
