"""Measures of a gait: contacts, strides, phases, torques and energy, references of healthy walking, outcome.

Functions of plain arrays: where no shape is said one value a tick, shape ``(n,)``, in SI. ``tick`` is the
sampling period in [s], ``phases`` are the indices of a table's, ``bounds`` are strides, the first tick of
each and of the next one, shape ``(n_strides, 2)``. A leg of a run as they read it is :func:`leg_record`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

# A module of the same name would be found in its place.
from twin_gait.measures.leg_record import leg_record as leg_record  # noqa: E402
