"""Rigid-body dynamics behind one interface: written for a structure of bodies, or Pinocchio's.

The interface is :mod:`twin_gait.simulation.backend`; nothing here knows an episode.
"""
