"""Sweeps: an experiment over any of its parameters, resumable."""
