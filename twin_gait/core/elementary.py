r"""Exponential, hyperbolic tangent, sine and cosine of our own.

Those of the C library differ in the last bit from one version, processor and compiler to the next, and a
vector of them from a scalar. These are additions, multiplications, a division and shifts of exponents, each
rounded once as IEEE 754 says, so that plain Python, scalar and vector machine code give the same bits, and
with them the logs. Nothing branches and nothing is looked up, so that a loop over them can be turned into
vectors. They need a compiler that leaves the order alone and does not fuse a product and a sum: neither
``fastmath`` nor ``contract``.

Two steps have another body in machine code, :func:`power_of_two` and :func:`whole_number`: there they are a
shift and a look at the bits (:data:`twin_gait.simulation.compiling.ON_BITS`).

Every coefficient is a number of its own here, not computed: it belongs to the function's bits.
tests/core/test_elementary.py derives them anew and bounds the errors against mpmath.
"""

import math

# To this a number below 2^51 adds its nearest whole number in the lowest bits; less this, it is that number.
_SHIFT = 6755399441055744.0  # 1.5 2^52

_PER_LN2 = 1.4426950408889634
# ln 2 in two parts. The first has 33 bits: a whole number of up to 20 bits times it is exact.
_LN2_HIGH, _LN2_LOW = 6.93147180369123816490e-01, 1.90821492927058770002e-10
# Where the power of two is 0, and where it is infinite.
_LEAST, _MOST = -709.0, 709.8
_FINITE = 709.4
# (e^r - 1 - r - r²/2 - r³/6) / r⁴ at the outer eight of eleven Chebyshev nodes of |r| <= 1.0005 ln(2)/2; with
# it, the relative error of e^r is below 1e-17.
_E3, _E4, _E5 = 0.16666666666666666, 0.04166666666660752, 0.008333333333329354
_E6, _E7, _E8 = 0.0013888888925296498, 0.00019841269868069235, 2.4801510589825806e-05
_E9, _E10, _E11 = 2.7557261277151255e-06, 2.7624430419539746e-07, 2.5103397436602313e-08

# r (e^r + 1) / (e^r - 1) = 2 + R2 r² + ..., |r| <= ln(2)/2, by fdlibm's minimax polynomial (Sun Microsystems
# 1993, e_exp.c); its error is below 2.1e-18.
_R2, _R4, _R6 = 1.66666666666666019037e-01, -2.77777777770155933842e-03, 6.61375632143793436117e-05
_R8, _R10 = -1.65339022054652515390e-06, 4.13813679705723846039e-08

_PER_QUARTER = 0.6366197723675814  # 2/π
# π/2 in three parts. The first two have 38 bits: a whole number of up to 15 bits times either is exact.
_QUARTER_HIGH, _QUARTER_MIDDLE = 1.5707963267923333, 2.5633441515839558e-12
_QUARTER_LOW = 1.0562999066987428e-23
# Sine and cosine on |r| <= π/4 by fdlibm's minimax polynomials (Sun Microsystems 1993, k_sin.c and k_cos.c).
_S3, _S5, _S7 = -1.66666666666666324348e-01, 8.33333333332248946124e-03, -1.98412698298579493134e-04
_S9, _S11, _S13 = 2.75573137070700676789e-06, -2.50507602534068634195e-08, 1.58969099521155010221e-10
_C4, _C6, _C8 = 4.16666666666666019037e-02, -1.38888888888741095749e-03, 2.48015872894767294178e-05
_C10, _C12, _C14 = -2.75573143513906633035e-07, 2.08757232129817482790e-09, -1.13596475577881948265e-11

# From here on the hyperbolic tangent is 1.
_SATURATED = 22.0


def power_of_two(shifted: float) -> float:
    """Two to the power of a whole number, exactly.

    ``shifted``: the whole number, from -1023 to 1024, added to 1.5 2^52. Returns the power; 0 at -1023,
    infinity at 1024, NaN of NaN.
    """
    number = shifted - _SHIFT
    if number != number:
        return number
    if number > 1023.0:
        return math.inf
    return math.ldexp(1.0, int(number)) if number > -1023.0 else 0.0


def whole_number(shifted: float) -> int:
    """The whole number in the lowest bits of a sum with 1.5 2^52; only its own lowest bits count.

    ``shifted``: the sum; of what is not finite any number is returned.
    """
    return int(shifted - _SHIFT) if math.isfinite(shifted) else 0


def _grown(x: float) -> tuple[float, float]:
    r"""Growth and scale :math:`e^r - 1,\ 2^n` with :math:`x = n \ln 2 + r`, :math:`|r| \le \ln(2)/2`.

    The rounding of r is kept: only what is small is computed from the rounded r.
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
    """Exponential function, within 1 unit in the last place.

    ``x``: any number; NaN gives NaN. Returns :math:`e^x`; 0 below -708.74, where it would be less than
    1.6e-308, and infinity above 709.43, where it would be more than 1.2e308.
    """
    x = _LEAST if x < _LEAST else x
    x = _MOST if x > _MOST else x
    growth, scale = _grown(x)
    return (1.0 + growth) * scale


def settled_share(x: float) -> float:
    """Share by which an exponential has settled, however small it is.

    ``x``: time in time constants, or whatever else counts in them; NaN gives NaN. Returns :math:`1 - e^{-x}`,
    within 1 unit in the last place, and within 2 where it is negative; held at -1.2e308 below -709.4.
    """
    x = -_FINITE if x < -_FINITE else x
    x = -_LEAST if x > -_LEAST else x
    growth, scale = _grown(-x)
    return (1.0 - scale) - scale * growth


def hyperbolic_tangent(x: float) -> float:
    r"""Hyperbolic tangent, within 3 units in the last place.

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
    r"""Sine and cosine, both within 1.5 units in the last place up to 50 000 rad.

    With :math:`\varphi = n\,\pi/2 + r`, :math:`|r| \le \pi/4`, they are those of r, by quadrant. Beyond
    50 000 rad, 8 000 turns, the products with n are rounded, and the results are those of an angle that is
    off by as much as two roundings of its own; beyond :math:`10^9` rad they mean nothing and may lie outside
    [-1, 1]. A run that gets there has diverged long before.

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
