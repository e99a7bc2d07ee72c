"""Pictures of a run, and the canvas for further pictures; matplotlib is imported when one is drawn."""
