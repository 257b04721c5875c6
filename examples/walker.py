"""How fast must a walker lean on at the start of a step to get over the standing leg? Found by halving an interval.

Run it by `python examples/walker.py`.
"""

import numpy as np

import vlmb

step = vlmb.load_scene("single_support")  # shank, thigh and trunk over one foot, 0.3 rad behind it at the start


def vault(rate):
    """Run a step that begins with all links turning forwards at a rate [rad/s]."""
    rates = {f"psi{k}_dot": -rate for k in (1, 2, 3)}
    return vlmb.simulate(step.changed(start=rates, run={"duration": 1.5, "rtol": 1e-8, "atol": 1e-10}))


def gets_over(rate):
    """Whether the centre of mass passes over the foot within 1.5 s."""
    return vault(rate)["com.x"].max() > 0.0


low, high = 0.2, 3.0
while high - low > 0.005:
    middle = 0.5 * (low + high)
    low, high = (low, middle) if gets_over(middle) else (middle, high)

run = vault(high)
start = np.array([run[f"com.{axis}"][0] for axis in "xyz"])
rigid = np.sqrt(2.0 * 9.81 / np.linalg.norm(start) * (1.0 - np.sin(step.start["psi1"])))  # all mass in one point, a rigid leg
print(f"the least rate is {high:.2f} rad/s; a point mass on a rigid leg needs {rigid:.2f} rad/s")
print(f"the leg carries up to {np.linalg.norm(run.hinge_force('shank'), axis=1).max():.0f} N of {72.0 * 9.81:.0f} N of weight")
