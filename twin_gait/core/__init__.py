"""The laws, each once: pure typed functions on plain numbers and arrays.

A law imports only :mod:`math` and :mod:`numpy`, keeps no state, reads no clock and draws no random number.
The reference engine calls these functions as plain Python, and the compiled engine compiles the same
functions, so there is no second copy of a law that could differ. Exponentials, sines and cosines are those of
:mod:`twin_gait.core.elementary`, and squares are plain products, because the functions of NumPy and of the C
library differ in the last bit from one version and machine to the next.
"""
