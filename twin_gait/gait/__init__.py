"""Phases, the gait table, its guards, and the state machine of a leg."""
