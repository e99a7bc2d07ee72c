"""Reproduction of the falls of the knee: figures A.1, A.2 and B.1 to B.6 of the thesis.

A weight falls from 90° to the stop at 125° under the duty-based transparency control of equations (2.1a) and
(2.1b). The shape of the falls was calibrated; the order of their roughness, the effect that A compensates and
the cause of the break-away were not. Claims are in thesis/claims.yaml, their results in
docs/background/reproduction.md. 3 s on one core; exits with 1 if a predicted number leaves its band.
"""

# %%
from gallery import read_options
from thesis import falls_figures as figures
from thesis.claims import Answers
from thesis.falls import (
    MASSES,
    beginnings,
    breakaway_numbers,
    duty_numbers,
    fall_numbers,
    falls_of,
    neutral_gain,
)

answers = Answers("thesis_falls", read_options("thesis_falls"))

# %% [markdown]
# ## Figures A.1 and A.2: the two laws of the duty cycle

# %%
answers.add("fig_A_1", duty_numbers(), figures.draw_static_duty(falls_of(MASSES[-1])[:3]))
answers.add("fig_A_2", {"neutral_gain": neutral_gain()}, figures.draw_viscous_duty(falls_of(MASSES[0])))

# %% [markdown]
# ## Figures B.1 to B.5: the falls for each weight

# %%
for index, mass in enumerate(MASSES):
    picture = figures.draw_falls({each: falls_of(each) for each in MASSES}) if index == 0 else None
    answers.add(f"fig_B_{index + 1}", fall_numbers(mass), picture)

# %% [markdown]
# ## Figure B.6: cause of the break-away of the shaken joint

# %%
first_instants = beginnings()
numbers = breakaway_numbers(first_instants)
answers.add("fig_B_6", numbers, figures.draw_breakaway(first_instants))

# %%
answers.conclude()
