"""Offline replay of recorded walks: the decisions of a gait table on measurements from a log."""
