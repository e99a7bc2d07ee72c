"""Tuning of a gait table to a wearer: screening, search, robust set, report."""
