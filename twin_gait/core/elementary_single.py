"""Constants of :mod:`twin_gait.core.elementary` for 32-bit numbers, by the names of those that they replace.

The polynomials stay, each coefficient rounded. What depends on the length of a number is another:

- what a number is added to so that its nearest whole number stands in the lowest bits;
- the parts of ln 2 and π/2, all but the last with so few bits that a whole number times one is exact: one of
  up to 9 bits with ln 2, and of up to 11 with π/2;
- the ends: where the power of two is 0 and where it is infinite, and where the hyperbolic tangent is 1.

tests/firmware/test_elementary_single.py derives them anew and bounds the errors against mpmath.
"""

SINGLE: dict[str, float] = {
    "_SHIFT": 12582912.0,  # 1.5 2^23
    "_PER_LN2": 1.4426950216293335,
    "_LN2_HIGH": 0.693145751953125,
    "_LN2_LOW": 1.428606765330187e-06,
    "_LEAST": -88.0,
    "_MOST": 88.8,
    "_FINITE": 88.3,
    "_PER_QUARTER": 0.6366197466850281,
    "_QUARTER_HIGH": 1.57080078125,
    "_QUARTER_MIDDLE": -4.454515874385834e-06,
    "_QUARTER_LOW": 6.07710062827671e-11,
    "_SATURATED": 10.0,
}
