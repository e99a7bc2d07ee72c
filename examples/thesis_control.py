"""Reproduction of torque and impedance control of the knee: figures 2.12, 2.20 and 3.5 to 3.7 of the thesis.

A hand imposes motions on the simulated knee with friction compensation, alone and with a virtual spring; in
addition to the torque of the motor, which the thesis logs, the bench shows the torque of the hand. Claims are
in thesis/claims.yaml, their results in docs/background/reproduction.md.
5 s on one core; exits with 1 if a predicted number leaves its band.
"""

# %%
from gallery import form_of
from thesis import bench, control, velocity
from thesis import control_figures as figures
from thesis.claims import Answers

from twin_gait.simulation import simulate_bench

answers = Answers("thesis_control", form_of("thesis_control"))

# %% [markdown]
# ## Figures 2.12 and 2.20: old friction model of TWIN, and linear stiffness

# %%
slow, quick = control.old_model_test(*control.SLOW), control.old_model_test(*control.QUICK)
answers.add("fig_2_12", control.old_model_numbers(slow), figures.draw_old_model(slow, quick))

spring = control.spring_test()
torque = control.SPRING_ANGLE * bench.slope_per_deg(spring)
answers.add("fig_2_20", {"torque": torque}, figures.draw_spring(spring))

# %% [markdown]
# ## Figure 3.5: target, measured and recomputed current

# %%
currents = [control.current_errors(hand) for hand in control.HANDS]
answers.add("fig_3_5", control.current_numbers(currents), figures.draw_currents(currents))

# %% [markdown]
# ## Figure 3.6: a virtual spring with friction compensation

# %%
led, slopes = control.spring_test(bench.GAINS[0]), control.simulated_slopes()
answers.add("fig_3_6", control.impedance_numbers(led, slopes), figures.draw_impedance(led, slopes))

# %% [markdown]
# ## Figure 3.7: effect of the gain on the loops of motor and hand

# %%
controls = [bench.torque_control(gain, stiffness=bench.STIFFNESS) for gain in bench.GAINS]
tests = [bench.with_ideal_current(bench.moved_by_hand(each)) for each in controls]
loops = [simulate_bench(test, seed=bench.SEED) for test in tests]
released = [simulate_bench(bench.pushed_and_let_go(each), seed=bench.SEED) for each in controls]
areas = [control.loop_areas(ratio) for ratio in (bench.RATIO, control.OTHER_RATIO)]
answers.add("fig_3_7", control.gain_numbers(areas, released), figures.draw_gain(loops, released, areas))

# %% [markdown]
# ## The delay of the velocity filter

# %%
delay = velocity.filter_delay()
answers.add("filter_delay", velocity.delay_numbers(delay), figures.draw_delay(delay))

# %%
answers.conclude()
