"""Virtual people: seeded draws of stature, body mass and sex over the 5th to 95th percentile.

Person number i of a seed is the same in a cohort of any size.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from statistics import NormalDist

import numpy as np

from twin_gait import Sex
from twin_gait.parameters.quantities import require
from twin_gait.parameters.wearer import Patient

HEAVIEST_WEARER = 110.0  # [kg], the heaviest wearer of TWIN (thesis, table 2.1)

HIGHEST_SHARE = 0.95  # 5th to 95th percentile (thesis, table 2.1)
_REACH = NormalDist().inv_cdf(HIGHEST_SHARE)


@dataclass(frozen=True, kw_only=True)
class BodySizes:
    """Stature and body mass of the people of one sex.

    Attributes:
        stature_mean: In [m].
        stature_deviation: Standard deviation in [m].
        mass_mean: In [kg].
        mass_deviation: Standard deviation in [kg].
        correlation: Of stature and mass.
    """

    stature_mean: float
    stature_deviation: float
    mass_mean: float
    mass_deviation: float
    correlation: float


# G. Heinz, L. J. Peterson, R. W. Johnson, C. J. Kerk: Exploring relationships in body dimensions, Journal of
# Statistics Education 11 (2003), no. 2: 247 men and 260 women, young and physically active. Correlation of
# the men from the slope of mass on stature, 0.783 kg/cm. The deviations of mass and the correlation of the
# women are assumptions: as remembered of these data, not read again.
SIZES: Mapping[Sex, BodySizes] = {
    Sex.MALE: BodySizes(
        stature_mean=1.777, stature_deviation=0.0718, mass_mean=78.1, mass_deviation=10.5, correlation=0.535
    ),
    Sex.FEMALE: BodySizes(
        stature_mean=1.649, stature_deviation=0.0654, mass_mean=60.6, mass_deviation=9.6, correlation=0.43
    ),
}


def cohort(
    count: int, seed: int, *, like: Patient | None = None, sizes: Mapping[Sex, BodySizes] = SIZES
) -> tuple[Patient, ...]:
    """Draw virtual people.

    Both sexes are equally likely. Stature and mass are correlated lognormal variables, as in adults by sex
    (M. P. Silverman, T. C. Lipscombe, Open Journal of Statistics 12, 2022), drawn again until both lie
    between the 5th and the 95th percentile of the sex and the mass is one that the device carries.

    ``count``: number of people, 1 or more. ``seed``: 0 or more. ``like``: person whose efforts and conditions
    all people share; the default wearer is mass alone. ``sizes``: of the population. Raises ParameterError if
    count, seed or sizes are invalid.
    """
    require(count >= 1, "count", "1 or more", count)
    require(set(sizes) == set(Sex), "sizes", "those of both sexes", sorted(sizes))
    for sex, size in sizes.items():
        lightest = _lognormal(size.mass_mean, size.mass_deviation, -_REACH)
        wanted = f"a 5th percentile below {HEAVIEST_WEARER:g} kg"
        require(lightest < HEAVIEST_WEARER, f"{sex} mass_mean", wanted, lightest)
    pattern = Patient() if like is None else like
    return tuple(_person(pattern, sizes, np.random.SeedSequence(seed, spawn_key=(i,))) for i in range(count))


def _person(pattern: Patient, sizes: Mapping[Sex, BodySizes], seed: np.random.SeedSequence) -> Patient:
    generator = np.random.default_rng(seed)
    sex = list(Sex)[int(generator.integers(len(Sex)))]
    size = sizes[sex]
    correlation = _correlation_of_logarithms(size)
    while True:
        first, second = (float(item) for item in generator.standard_normal(2))
        second = correlation * first + math.sqrt(1.0 - correlation * correlation) * second
        mass = _lognormal(size.mass_mean, size.mass_deviation, second)
        if max(abs(first), abs(second)) <= _REACH and mass <= HEAVIEST_WEARER:
            height = _lognormal(size.stature_mean, size.stature_deviation, first)
            return replace(pattern, sex=sex, height=height, mass=mass)


def _lognormal(mean: float, deviation: float, standard: float) -> float:
    """Return a lognormal variable whose logarithm is a number of standard deviations above its mean."""
    spread = math.sqrt(math.log1p((deviation / mean) ** 2))
    return mean * math.exp(spread * standard - 0.5 * spread * spread)


def _correlation_of_logarithms(size: BodySizes) -> float:
    shares = size.stature_deviation / size.stature_mean, size.mass_deviation / size.mass_mean
    spreads = [math.sqrt(math.log1p(share**2)) for share in shares]
    return math.log1p(size.correlation * shares[0] * shares[1]) / (spreads[0] * spreads[1])
