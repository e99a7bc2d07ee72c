"""Scales of the arrows: the scene draws with them, the page explains them."""

METRES_PER_NEWTON = 0.001  # length of the arrow of a ground force
FULL_TORQUE = (
    60.0  # of the longest arrow of a motor torque [N m]: about the largest of a step of the shipped presets
)
