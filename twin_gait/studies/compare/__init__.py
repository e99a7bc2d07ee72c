"""Controllers beside each other: the same wearer, the same belt, another law between angle and torque."""
