"""Constants of :mod:`twin_gait.core.elementary` for 32-bit numbers, by the names that they replace.

The polynomials stay the same, with each coefficient rounded. The constants that depend on the length of a
number differ:

- the number that is added so that the nearest whole number is in the lowest bits;
- the parts of ln 2 and π/2, all but the last with so few bits that the product with a whole number is exact:
  a whole number of up to 9 bits for ln 2, and of up to 11 bits for π/2;
- the limits: where the power of two is 0, where it is infinite, and where the hyperbolic tangent is 1.

tests/firmware/test_elementary_single.py derives the constants anew and bounds the errors against mpmath.
"""

SINGLE: dict[str, float] = {
    "_SHIFT": 12582912.0,  # 1.5 2^23
    "_PER_LN2": 1.4426950216293335,
    "_LN2_HIGH": 0.693145751953125,
    "_LN2_LOW": 1.428606765330187e-06,
    "_MIN_ARGUMENT": -88.0,
    "_MAX_ARGUMENT": 88.8,
    "_FINITE": 88.3,
    "_PER_QUARTER": 0.6366197466850281,
    "_QUARTER_HIGH": 1.57080078125,
    "_QUARTER_MIDDLE": -4.454515874385834e-06,
    "_QUARTER_LOW": 6.07710062827671e-11,
    "_SATURATED": 10.0,
}
