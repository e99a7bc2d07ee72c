"""Recorded walks through a gait table."""
