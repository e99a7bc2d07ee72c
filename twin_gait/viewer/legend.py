"""Colours and scales of the arrows: the scene draws with them, the page explains them."""

from __future__ import annotations

from twin_gait.palette import BLUE, REDDISH_PURPLE, VERMILLION

FORCE_COLOUR = REDDISH_PURPLE
METRES_PER_NEWTON = 0.001  # length of the arrow of a ground force
FLEXION_COLOUR, EXTENSION_COLOUR = VERMILLION, BLUE  # of the arrows of motor torques
FULL_TORQUE = 60.0  # of the longest of them [N m]: about the largest of a step of the shipped presets
