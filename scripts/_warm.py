"""Compile the engine once, before anything runs side by side: a few short runs that between them use all of it."""

import vlmb

LEG = {"name": "leg", "rod": {"length": 0.5, "mass": 3.0}, "tip_mass": 2.0, "lower": {"length": 0.3, "stiffness": 2e3}}
FORCES = [{"on": "M_psi1", "law": "sin(3*t)"}, {"between": ["base", "leg"], "stiffness": 9.0, "damping": 1.0}]
for method in ("adams", "radau"):
    run = {"duration": 0.1, "method": method}
    scene = {"base": {"kind": "ski", "mass": 5.0, "inertia": 0.6}, "links": [LEG], "forces": FORCES, "start": {"psi1": 1.2}}
    vlmb.simulate({**scene, "run": run}).summary()
