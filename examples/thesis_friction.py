"""Reproduction of the identification of friction: figures 3.1 to 3.4 and table 3.1 of the thesis.

Two campaigns per joint are simulated on the bench with the friction of table 3.1: the falls of the thesis and
motor-driven tests in both directions. They are identified as in the thesis and without delay. The claims, and
the reasons for the widths of their bands, are in thesis/claims.yaml; their results are in
docs/background/reproduction.md. 35 s on one core, ``--quick`` for figure 3.1 alone; exits with 1 if a
predicted number leaves its band.
"""

# %%
from gallery import read_options
from thesis import friction_figures as figures
from thesis import velocity
from thesis.claims import Answers
from thesis.friction import (
    DRIVEN,
    FALLS,
    HIP,
    JOINTS,
    KNEE,
    LATE,
    PROMPT,
    TREATMENTS,
    comparison_numbers,
    fit_campaign,
    fit_numbers,
    table_numbers,
)

from twin_gait.studies.campaign import TWO_WAY_SPEEDS

form = read_options("thesis_friction")
answers = Answers("thesis_friction", form)

# %% [markdown]
# ## Figure 3.1: effect of the thesis's post-processing on a velocity

# %%
fall = velocity.filtered_fall()
answers.add("fig_3_1", velocity.fall_numbers(fall), figures.draw_velocities(fall))

# %% [markdown]
# ## Figures 3.2 and 3.3: equation (3.1) fitted to the falls of knee and hip

# %%
for figure, joint in () if form.quick else (("fig_3_2", KNEE), ("fig_3_3", HIP)):
    late, prompt = (fit_campaign(joint, FALLS, processing, forward=True) for processing in (LATE, PROMPT))
    numbers = fit_numbers(joint, late, prompt, fit_campaign(joint, DRIVEN, LATE))
    answers.add(figure, numbers, figures.draw_fits(joint, late, prompt))

# %% [markdown]
# ## Figure 3.4: the laws of both joints from motor-driven tests

# %%
if not form.quick:
    driven = {joint: fit_campaign(joint, DRIVEN, PROMPT) for joint in JOINTS}
    picture = figures.draw_comparison(driven, TWO_WAY_SPEEDS[-1])
    answers.add("fig_3_4", comparison_numbers(driven), picture)

# %% [markdown]
# ## Table 3.1: parameters by campaign and processing

# %%
if not form.quick:
    fits = {
        (joint, index): fit_campaign(joint, protocol, processing)
        for joint in JOINTS
        for index, (protocol, processing, *_) in enumerate(TREATMENTS)
    }
    as_printed = fit_campaign(KNEE, DRIVEN, PROMPT, mass_as_printed=True)
    answers.add("table_3_1", table_numbers(fits, as_printed), figures.draw_table(fits))

# %%
answers.conclude()
