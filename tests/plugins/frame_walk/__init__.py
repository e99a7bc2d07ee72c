"""A world of another package: both legs step in the air, in a frame that holds the pelvis."""
