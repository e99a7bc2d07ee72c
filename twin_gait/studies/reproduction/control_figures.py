"""The figures of the thesis that controllers make, each as a recipe.

Figures 2.12 and 2.20 (models), 3.5 (current), 3.6 and 3.7 (impedance and gain); and what the thesis says in
words: the delay of the filter, and the gains at which a joint and the leg become unstable.
"""

from __future__ import annotations

from twin_gait.studies.reproduction.claim import Recipe
from twin_gait.studies.reproduction.control_current import CURRENT
from twin_gait.studies.reproduction.control_delay import DELAY
from twin_gait.studies.reproduction.control_gain import GAIN
from twin_gait.studies.reproduction.control_impedance import IMPEDANCE
from twin_gait.studies.reproduction.control_leg_figure import LEG
from twin_gait.studies.reproduction.control_limits_figure import LIMITS
from twin_gait.studies.reproduction.control_models import OLD_MODEL, SPRING

RECIPES: tuple[Recipe, ...] = (OLD_MODEL, SPRING, CURRENT, IMPEDANCE, GAIN, DELAY, LIMITS, LEG)
