"""Steps of a tick: ordinary functions of the record of an episode, or of a joint, leg, sole or limb of it.

:mod:`twin_gait.simulation.schedule` defines their order. Compiled with a generated kernel they form the
compiled engine, uncompiled with Pinocchio the reference engine; see :mod:`twin_gait.simulation.binding`.

A step processes one episode and does not depend on the number of episodes in lockstep. Only the integration
(:mod:`.motion`) and the evaluation of the guards (:mod:`.phases`) contain loops over the episodes of a block;
:mod:`twin_gait.simulation.lanes` lists the conditions under which such a loop is vectorized.
"""
