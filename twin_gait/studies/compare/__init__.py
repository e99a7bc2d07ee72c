"""Comparison of controllers: the same wearer and belt, with different laws from angle to torque."""
