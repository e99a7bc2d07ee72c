"""See a run or a URDF: one page to keep, or a live page in the browser."""
