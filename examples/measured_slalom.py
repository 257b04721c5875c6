"""A slalom whose rider bends the legs as a recording says, and what knees and hips must hold then.

Run it by `python examples/measured_slalom.py`.
"""

import numpy as np

import vlmb

planned = vlmb.load_scene("slalom")  # a model that comes with vlmb; its fourth row is xi1_1 = length - bend*cos(2*k*x)
ride = vlmb.simulate(planned, duration=6.0)

# Stands for motion capture: the legs of that ride, 100 times a second, with errors of 1 mm (normal, independent).
times = np.arange(0.0, 6.001, 0.01)
errors = np.random.default_rng(7).normal(0.0, 1e-3, len(times))
legs = np.interp(times, ride.t, ride["xi1_1"]) + errors
recording = {"name": "mocap", "time": times, "columns": {"legs": {"values": legs, "unit": "m"}}}

rows = [*planned.programme.constraints[:3], "xi1_1 = mocap.legs"]
measured = planned.changed(data=[recording], programme={"constraints": rows})
followed = vlmb.simulate(measured, duration=6.0)
print(followed.message)

within = (ride.t > 0.5) & (ride.t < 5.5)  # the ends of smoothed data rest on samples of one side
for name in ("xi1_1", "F1_1", "M_psi1"):
    read = [run.controls[name] if name in run.controls else run[name] for run in (ride, followed)]
    off = np.abs(read[1] - read[0])[within].max()
    print(f"{name:<7s} up to {np.abs(read[0]).max():8.4g}, by the recording within {off:.2g}")
print(f"energy is kept to {np.abs(followed['balance']).max():.1e} J")
