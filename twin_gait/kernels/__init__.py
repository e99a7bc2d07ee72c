"""Rigid-body dynamics with one interface: generated for a structure of bodies, or by Pinocchio.

The interface is :mod:`twin_gait.simulation.backend`; no module here depends on an episode.
"""
