"""Figures and tables of the thesis, made again on the simulated bench."""
