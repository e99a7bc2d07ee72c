"""Gait simulation of the TWIN leg exoskeleton."""

__version__ = "0.1.0"
