"""Live sessions: a gait that is simulated in real time and can be changed while it runs."""
