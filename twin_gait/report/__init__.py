"""Pictures of a run, and the canvas for pictures of one's own; matplotlib is imported when one is drawn."""
