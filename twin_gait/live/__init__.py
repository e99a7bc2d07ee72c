"""A gait that is simulated in real time and changed while it walks."""
