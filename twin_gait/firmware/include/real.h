/* The number type of the firmware, and the few operations that C does otherwise than Python.
   Numbers are float, or double with -DREAL_DOUBLE. Not a medical device. */
#ifndef TWIN_GAIT_REAL_H
#define TWIN_GAIT_REAL_H

#include <float.h>
#include <math.h> /* INFINITY and NAN alone: nothing of the library is called */
#include <stdbool.h>
#include <stdint.h>

#if defined(__FAST_MATH__) || (FLT_EVAL_METHOD != 0)
#error "every operation has to be rounded once, as IEEE 754 says"
#endif

#ifdef REAL_DOUBLE
typedef double real;
typedef int64_t real_whole;
typedef uint64_t real_bits;
#define REAL(x) x
#define REAL_OR(wide, single) (wide)
#define REAL_LARGEST DBL_MAX
#define REAL_WHOLE 4503599627370496.0 /* 2^52: from here on every number is a whole one */
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

/* Magnitude; of -0 it is 0. */
static inline real real_abs(real x)
{
    return x <= REAL(0.0) ? REAL(0.0) - x : x;
}

static inline bool real_isfinite(real x)
{
    return real_abs(x) <= REAL_LARGEST;
}

/* Largest whole number that is not above; what is not finite passes. */
static inline real real_floor(real x)
{
    if (!(real_abs(x) < REAL_WHOLE)) {
        return x;
    }
    const real whole = (real)(real_whole)x;
    return whole > x ? whole - REAL(1.0) : whole;
}

/* The same of 32 bits, the nearest there is; 0 of what is no number. */
static inline int32_t int_floor(real x)
{
    if (!(x >= REAL(-2147483648.0))) {
        return x < REAL(0.0) ? INT32_MIN : 0;
    }
    return x < REAL(2147483648.0) ? (int32_t)real_floor(x) : INT32_MAX;
}

/* The first of two, unless the second is larger (smaller). */
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

/* Quotient, rounded downwards; the divisor is not 0. */
static inline int32_t int_divide(int32_t a, int32_t b)
{
    const int32_t quotient = a / b;
    return a % b != 0 && (a < 0) != (b < 0) ? quotient - 1 : quotient;
}

/* What then remains, with the sign of the divisor. */
static inline int32_t int_modulo(int32_t a, int32_t b)
{
    const int32_t rest = a % b;
    return rest != 0 && (rest < 0) != (b < 0) ? rest + b : rest;
}

/* Two to the power of a whole number that was added to 1.5 times two to the power of REAL_MANTISSA. */
static inline real power_of_two(real shifted)
{
    RealBits value = {shifted};
    value.bits = (value.bits + (real_bits)REAL_BIAS) << REAL_MANTISSA;
    return value.number;
}

/* Lowest bits of that whole number. */
static inline int32_t whole_number(real shifted)
{
    const RealBits value = {shifted};
    const real_bits lowest = value.bits & (real_bits)0x3FFFFFFF;
    return (int32_t)lowest;
}

#endif
