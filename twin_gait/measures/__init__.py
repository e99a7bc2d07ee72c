"""Measures of gait and effort, from arrays: strides, phases, clearance, torque, energy, references."""
