"""Simulation of an experiment, or of one joint on its bench; it accesses no files except the code cache."""
