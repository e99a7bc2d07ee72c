"""Exponential, hyperbolic tangent, sine and cosine with the same bits on every machine.

The functions of the C library differ in the last bit from one version, processor and compiler to the next,
and vector versions differ from scalar ones. The functions here consist of additions, multiplications, a
division and shifts of exponents, each rounded once according to IEEE 754, so that plain Python, scalar and
vector machine code give the same bits, and therefore the same logs. There are no branches and no table
look-ups, so that a compiler can vectorize a loop over them. The compiler must keep the order of operations
and must not fuse a product and a sum: neither ``fastmath`` nor ``contract``.

Two functions have another body in machine code, :func:`power_of_two` and :func:`whole_number`: a shift, and a
reinterpretation of the bits (:data:`twin_gait.simulation.compiling.BIT_FUNCTIONS`).

Every coefficient is a literal number, not computed, because it determines the bits of the function.
tests/core/test_elementary.py derives them anew and bounds the errors against mpmath.
"""

import math

# The sum of this and a number below 2^51 has the nearest whole number in its lowest bits; the sum minus this
# is that whole number.
_SHIFT = 6755399441055744.0  # 1.5 2^52

_PER_LN2 = 1.4426950408889634
# ln 2 in two parts. The first has 33 bits: its product with a whole number of up to 20 bits is exact.
_LN2_HIGH, _LN2_LOW = 6.93147180369123816490e-01, 1.90821492927058770002e-10
# Arguments at which the power of two is 0, and at which it is infinite.
_MIN_ARGUMENT, _MAX_ARGUMENT = -709.0, 709.8
_FINITE = 709.4
# Polynomial for (e^r - 1 - r - r²/2 - r³/6) / r⁴, fitted at the outer eight of eleven Chebyshev nodes of
# |r| <= 1.0005 ln(2)/2; with it, the relative error of e^r is below 1e-17.
_E3, _E4, _E5 = 0.16666666666666666, 0.04166666666660752, 0.008333333333329354
_E6, _E7, _E8 = 0.0013888888925296498, 0.00019841269868069235, 2.4801510589825806e-05
_E9, _E10, _E11 = 2.7557261277151255e-06, 2.7624430419539746e-07, 2.5103397436602313e-08

# fdlibm's minimax polynomial (Sun Microsystems 1993, e_exp.c) for r (e^r + 1) / (e^r - 1) = 2 + R2 r² + ...,
# |r| <= ln(2)/2; its error is below 2.1e-18.
_R2, _R4, _R6 = 1.66666666666666019037e-01, -2.77777777770155933842e-03, 6.61375632143793436117e-05
_R8, _R10 = -1.65339022054652515390e-06, 4.13813679705723846039e-08

_PER_QUARTER = 0.6366197723675814  # 2/π
# π/2 in three parts. The first two have 38 bits: their products with a whole number of up to 15 bits are
# exact.
_QUARTER_HIGH, _QUARTER_MIDDLE = 1.5707963267923333, 2.5633441515839558e-12
_QUARTER_LOW = 1.0562999066987428e-23
# Sine and cosine on |r| <= π/4 by fdlibm's minimax polynomials (Sun Microsystems 1993, k_sin.c and k_cos.c).
_S3, _S5, _S7 = -1.66666666666666324348e-01, 8.33333333332248946124e-03, -1.98412698298579493134e-04
_S9, _S11, _S13 = 2.75573137070700676789e-06, -2.50507602534068634195e-08, 1.58969099521155010221e-10
_C4, _C6, _C8 = 4.16666666666666019037e-02, -1.38888888888741095749e-03, 2.48015872894767294178e-05
_C10, _C12, _C14 = -2.75573143513906633035e-07, 2.08757232129817482790e-09, -1.13596475577881948265e-11

# Argument from which on the hyperbolic tangent is 1.
_SATURATED = 22.0


def power_of_two(shifted: float) -> float:
    """Compute two to the power of a whole number, exactly.

    ``shifted``: the whole number, from -1023 to 1024, added to 1.5 2^52. Returns the power; 0 for -1023,
    infinity for 1024, NaN for NaN.
    """
    number = shifted - _SHIFT
    if number != number:
        return number
    if number > 1023.0:
        return math.inf
    return math.ldexp(1.0, int(number)) if number > -1023.0 else 0.0


def whole_number(shifted: float) -> int:
    """Extract the whole number from the lowest bits of a sum with 1.5 2^52; only its lowest bits are exact.

    ``shifted``: the sum; if it is not finite, an arbitrary number is returned.
    """
    return int(shifted - _SHIFT) if math.isfinite(shifted) else 0


def _grown(x: float) -> tuple[float, float]:
    r"""Compute growth and scale :math:`e^r - 1,\ 2^n` with :math:`x = n \ln 2 + r`, :math:`|r| \le \ln(2)/2`.

    The rounding error of r is kept: only the small terms are computed from the rounded r.
    """
    shifted = x * _PER_LN2 + _SHIFT
    number = shifted - _SHIFT
    high, low = x - number * _LN2_HIGH, number * _LN2_LOW
    r = high - low
    square = r * r
    fourth = square * square
    first = (0.5 + _E3 * r) + (_E4 + _E5 * r) * square
    rest = ((_E6 + _E7 * r) + (_E8 + _E9 * r) * square) + (_E10 + _E11 * r) * fourth
    tail = first + rest * fourth
    growth, scale = high + (square * tail - low), power_of_two(shifted)
    return growth, scale


def exponential(x: float) -> float:
    """Compute the exponential function, within 1 unit in the last place.

    ``x``: any number; NaN gives NaN. Returns :math:`e^x`; 0 below -708.74, where it would be less than
    1.6e-308, and infinity above 709.43, where it would be more than 1.2e308.
    """
    x = _MIN_ARGUMENT if x < _MIN_ARGUMENT else x
    x = _MAX_ARGUMENT if x > _MAX_ARGUMENT else x
    growth, scale = _grown(x)
    return (1.0 + growth) * scale


def settled_share(x: float) -> float:
    """Compute the share by which an exponential has settled, :math:`1 - e^{-x}`, accurately for small x.

    ``x``: time in time constants, or any other dimensionless quantity; NaN gives NaN. The result is within 1
    unit in the last place, and within 2 where it is negative; it is constant at -1.2e308 below -709.4.
    """
    x = -_FINITE if x < -_FINITE else x
    x = -_MIN_ARGUMENT if x > -_MIN_ARGUMENT else x
    growth, scale = _grown(-x)
    return (1.0 - scale) - scale * growth


def hyperbolic_tangent(x: float) -> float:
    r"""Compute the hyperbolic tangent, within 3 units in the last place.

    With :math:`2|x| = n \ln 2 + r`, :math:`s = 2^n` and the even function :math:`R = r\,(e^r + 1)/(e^r - 1)`

    .. math::

        \tanh |x| = \frac{e^{2|x|} - 1}{e^{2|x|} + 1} = \frac{N}{N + 2\,(R - r)}, \qquad
        N = (s - 1)\,R + (s + 1)\,r

    ``x``: any number; NaN gives NaN. Returns the value in [-1, 1], exactly odd.
    """
    magnitude = abs(x)
    magnitude = _SATURATED if magnitude > _SATURATED else magnitude
    twice = 2.0 * magnitude
    shifted = twice * _PER_LN2 + _SHIFT
    number = shifted - _SHIFT
    r = (twice - number * _LN2_HIGH) - number * _LN2_LOW
    square = r * r
    fourth = square * square
    tail = (_R2 + _R4 * square) + ((_R6 + _R8 * square) + _R10 * fourth) * fourth
    even = 2.0 + square * tail
    scale = power_of_two(shifted)
    rise = (scale - 1.0) * even + (scale + 1.0) * r
    value = rise / (rise + 2.0 * (even - r))
    return value if x >= 0.0 else -value


def sine_cosine(angle: float) -> tuple[float, float]:
    r"""Compute sine and cosine, both within 1.5 units in the last place up to 50 000 rad.

    With :math:`\varphi = n\,\pi/2 + r`, :math:`|r| \le \pi/4`, they follow from sine and cosine of r, by
    quadrant. Beyond 50 000 rad, 8 000 turns, the products with n are rounded, and the results are those of an
    angle with an error of two roundings of its own; beyond :math:`10^9` rad they are meaningless and may lie
    outside [-1, 1]. A run that reaches such an angle has diverged long before.

    ``angle``: :math:`\varphi` in [rad]; NaN and infinity give NaN. Returns the sine and cosine, exactly odd
    and even.
    """
    shifted = angle * _PER_QUARTER + _SHIFT
    number, quadrant = shifted - _SHIFT, whole_number(shifted)
    r = ((angle - number * _QUARTER_HIGH) - number * _QUARTER_MIDDLE) - number * _QUARTER_LOW
    square = r * r
    fourth = square * square
    odd = (_S3 + _S5 * square) + (_S7 + _S9 * square) * fourth + (_S11 + _S13 * square) * (fourth * fourth)
    even = (_C4 + _C6 * square) + (_C8 + _C10 * square) * fourth + (_C12 + _C14 * square) * (fourth * fourth)
    half = 0.5 * square
    most = 1.0 - half
    sine_of_r, cosine_of_r = r + (r * square) * odd, most + (((1.0 - most) - half) + fourth * even)
    swapped = (quadrant & 1) != 0
    one, other = cosine_of_r if swapped else sine_of_r, sine_of_r if swapped else cosine_of_r
    sine = -one if (quadrant & 2) != 0 else one
    cosine = -other if ((quadrant + 1) & 2) != 0 else other
    return sine, cosine
