"""In what time may a crane carry its load to its place, so that it hardly sways there? Tried for twenty times.

Run it by `python examples/crane.py`.
"""

import numpy as np

import vlmb

crane = vlmb.load_scene("crane")  # slews, luffs, telescopes and hoists by laws over `time` seconds; the load hangs free


def carry(time):
    """Run until 6 s after the crane has come to rest; more than a period of the rope."""
    return vlmb.simulate(crane.changed_at({"parameters.time": time}), duration=time + 6.0, rtol=1e-8, atol=1e-10)


def sway(run, time):
    """The largest distance [m] of the load from under the boom's tip after the crane has come to rest."""
    off = run.position("rope", "tip") - run.position("boom", "tip")
    return np.hypot(off[:, 0], off[:, 1])[run.t > time].max()


times = np.linspace(5.0, 14.5, 20)
sways = [sway(carry(time), time) for time in times]
for time, off in zip(times, sways, strict=True):
    print(f"{time:5.1f} s  {off:6.3f} m  {'#' * round(40 * off / max(sways))}")

best = next(time for time, off in zip(times, sways, strict=True) if off < 0.15)
run = carry(best)
hoist, slewing = run.controls["F2_1"], np.abs(run.reactions["slewing"])
period = 2.0 * np.pi * np.sqrt(6.0 / 9.81)  # of 6 m of rope
print(f"in {best:.1f} s the load comes to rest within 0.15 m; the rope swings to and fro in {period:.1f} s")
print(f"the hoist carries {-hoist.max():.0f} to {-hoist.min():.0f} N, the slewing gear up to {slewing.max():.0f} N m")
