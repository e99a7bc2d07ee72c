/* The number type of the firmware, and the few operations in which C differs from Python.
   Numbers are float, or double with -DREAL_DOUBLE. Not a medical device. */
#ifndef TWIN_GAIT_REAL_H
#define TWIN_GAIT_REAL_H

#include <float.h>
#include <math.h> /* INFINITY, NAN and the square root only */
#include <stdbool.h>
#include <stdint.h>

#if defined(__FAST_MATH__) || (FLT_EVAL_METHOD != 0)
#error "every operation has to be rounded once, as IEEE 754 requires"
#endif

#ifdef REAL_DOUBLE
typedef double real;
typedef int64_t real_whole;
typedef uint64_t real_bits;
#define REAL(x) x
#define REAL_OR(wide, single) (wide)
#define REAL_LARGEST DBL_MAX
#define REAL_WHOLE 4503599627370496.0 /* 2^52: all larger numbers are integers */
#define REAL_MANTISSA 52
#define REAL_BIAS 1023
#else
typedef float real;
typedef int32_t real_whole;
typedef uint32_t real_bits;
#define REAL(x) x##f
#define REAL_OR(wide, single) (single##f) /* a constant that depends on the type */
#define REAL_LARGEST FLT_MAX
#define REAL_WHOLE 8388608.0f /* 2^23 */
#define REAL_MANTISSA 23
#define REAL_BIAS 127
#endif

typedef union {
    real number;
    real_bits bits;
} RealBits;

/* Return the magnitude; it is 0 for -0. */
static inline real real_abs(real x)
{
    return x <= REAL(0.0) ? REAL(0.0) - x : x;
}

static inline bool real_isfinite(real x)
{
    return real_abs(x) <= REAL_LARGEST;
}

/* Return the largest integer that is not greater; numbers that are not finite are returned unchanged. */
static inline real real_floor(real x)
{
    if (!(real_abs(x) < REAL_WHOLE)) {
        return x;
    }
    const real whole = (real)(real_whole)x;
    return whole > x ? whole - REAL(1.0) : whole;
}

/* Return the floor in 32 bits, limited to their range; 0 for NaN. */
static inline int32_t int_floor(real x)
{
    if (!(x >= REAL(-2147483648.0))) {
        return x < REAL(0.0) ? INT32_MIN : 0;
    }
    return x < REAL(2147483648.0) ? (int32_t)real_floor(x) : INT32_MAX;
}

/* Return the square root, which IEEE 754 rounds. No unit of a board calls it. */
static inline real real_sqrt(real x)
{
#ifdef REAL_DOUBLE
    return sqrt(x);
#else
    return sqrtf(x);
#endif
}

/* Return the first of two numbers, unless the second is larger (smaller). */
static inline real real_max(real a, real b)
{
    return b > a ? b : a;
}

static inline real real_min(real a, real b)
{
    return b < a ? b : a;
}

static inline int32_t int_abs(int32_t x)
{
    return x < 0 ? -x : x;
}

static inline int32_t int_max(int32_t a, int32_t b)
{
    return b > a ? b : a;
}

static inline int32_t int_min(int32_t a, int32_t b)
{
    return b < a ? b : a;
}

/* Return the quotient, rounded downwards; the divisor must not be 0. */
static inline int32_t int_divide(int32_t a, int32_t b)
{
    const int32_t quotient = a / b;
    return a % b != 0 && (a < 0) != (b < 0) ? quotient - 1 : quotient;
}

/* Return the remainder of this division, with the sign of the divisor. */
static inline int32_t int_modulo(int32_t a, int32_t b)
{
    const int32_t rest = a % b;
    return rest != 0 && (rest < 0) != (b < 0) ? rest + b : rest;
}

/* Return two to the power of an integer that was added to 1.5 times two to the power of REAL_MANTISSA. */
static inline real power_of_two(real shifted)
{
    RealBits value = {shifted};
    value.bits = (value.bits + (real_bits)REAL_BIAS) << REAL_MANTISSA;
    return value.number;
}

/* Return the lowest bits of this integer. */
static inline int32_t whole_number(real shifted)
{
    const RealBits value = {shifted};
    const real_bits lowest = value.bits & (real_bits)0x3FFFFFFF;
    return (int32_t)lowest;
}

#endif
