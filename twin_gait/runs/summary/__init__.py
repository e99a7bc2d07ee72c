"""A run in numbers: what goes into ``summary.json``."""
