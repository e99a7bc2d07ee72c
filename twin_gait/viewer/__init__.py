"""Viewer of a run or a URDF: a self-contained page, or a live page in the browser."""
