"""Measures of a gait: contacts, strides, phases, torques and energy, references of healthy walking, outcome.

Functions of plain arrays. Arrays have one value a tick, shape ``(n,)``, in SI units, unless a docstring gives
another shape. ``tick`` is the sampling period in [s], ``phases`` are indices of the phases of a gait table,
``bounds`` are strides: the first tick of each stride and of the next one, shape ``(n_strides, 2)``.
:func:`~twin_gait.measures.leg_record.leg_record` extracts one leg of a run in the form that the measures
read.
"""
