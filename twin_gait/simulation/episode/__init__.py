"""The loop of the compiled engine: a whole episode on plain arrays, one room for each part of a tick.

The rooms are plain Python that calls the functions of :mod:`twin_gait.core`; they are compiled together with
a generated kernel, which takes the place of the imports from ``kernel_interface``. The order of things in a
tick is that of the Pinocchio engine and stands in :mod:`twin_gait.simulation.episode.tick`: measure, watch,
decide, control, record, integrate.

Every function that needs the episode takes it first and begins with
``inputs, state = episode.inputs, episode.state``: :mod:`twin_gait.simulation.flattening` hands the arrays
over one by one in the compiled text, which compiles in half the time. In that text all rooms are one module,
so that no two of them may give a name to different things.
"""
