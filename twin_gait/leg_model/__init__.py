"""Rigid-body model of the legs: URDF, segments of the wearer, and the interface to Pinocchio."""
