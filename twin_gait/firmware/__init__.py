"""The controller as C, printed from the functions of the simulation, and the processors that run it."""
