"""Frozen parameters in SI units, checked on creation.

Every number that a user can change is a field of one of these dataclasses, documented with its source.
"""
