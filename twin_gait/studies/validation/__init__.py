"""The witnesses of this package, and their verdicts."""
