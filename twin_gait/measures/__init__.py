"""Measures of a gait: contacts, strides, phases, torques and energy, references of healthy walking, outcome.

Functions of plain arrays, one value a tick; a leg of a run as they read it is :func:`leg_record`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

# A module of the same name would be found in its place.
from twin_gait.measures.leg_record import leg_record as leg_record  # noqa: E402
