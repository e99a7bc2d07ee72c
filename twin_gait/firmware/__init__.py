"""The controller as C for a microcontroller, printed from the functions that the simulation runs."""
