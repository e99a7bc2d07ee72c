"""Statements of the thesis about the gain G: the limits at which knee and leg become unstable, and why.

The limits come from bisection over simulated pushes and releases, and from eigenvalues of the loop. Claims
are in thesis/claims.yaml, their results in docs/background/reproduction.md. 6 s on one core, ``--quick``
without the leg; exits with 1 if a predicted number leaves its band.
"""

# %%
from gallery import form_of
from thesis import limits_figures as figures
from thesis.bench import RATIO
from thesis.claims import Answers
from thesis.leg import leg_findings, leg_numbers
from thesis.limits import RATIOS, limit_numbers, limits_of, released

from twin_gait.simulation import simulate_bench

SHOWN_GAINS = (0.45, 0.6, 1.0)
form = form_of("thesis_limits")
answers = Answers("thesis_limits", form)

# %% [markdown]
# ## Gain at which the knee becomes unstable, against the ratio s of true to modelled friction

# %%
limits = [limits_of(ratio) for ratio in RATIOS]
releases = {gain: simulate_bench(released(gain, RATIO)) for gain in SHOWN_GAINS}
answers.add("joint_limit", limit_numbers(limits, releases[1.0]), figures.draw_limits(limits, releases))

# %% [markdown]
# ## Gains of hip and knee on the hanging leg

# %%
if not form.quick:
    leg = leg_findings()
    answers.add("leg_gains", leg_numbers(leg), figures.draw_leg(leg))

# %%
answers.conclude()
