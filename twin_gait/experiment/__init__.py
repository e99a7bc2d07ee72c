"""Experiment: one frozen value that contains everything a run needs, and its conversion to models."""
