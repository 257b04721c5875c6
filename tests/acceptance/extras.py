"""What the extras are for, once each: tables, NetCDF, a sweep on a cluster, a film, a C3D file, a robot."""

from __future__ import annotations

from pathlib import Path

import ezc3d
import numpy as np
from distributed import Client, LocalCluster

import vlmb
from vlmb.cli import main

run = vlmb.simulate("slalom", duration=0.2)
run.save("slalom.npz")
table = run.to_pandas(points=True, hinges=True)
assert table.attrs["units"]["normal"] == "N" and len(table) == len(run.t)
assert float(run.to_xarray()["speed"][-1]) == run["speed"][-1]

scene = vlmb.load_scene("one_link").changed(run={"duration": 0.2})
vary = {"start.psi1": [-0.5, -0.4]}
alone = vlmb.sweep(scene, vary, keep=["psi1:last"], output="sweep")
here = {"n_workers": 1, "threads_per_worker": 1, "processes": False, "dashboard_address": None}
with LocalCluster(**here) as cluster, Client(cluster) as client:
    assert vlmb.sweep(scene, vary, keep=["psi1:last"], executor=client).attrs["digest"] == alone.attrs["digest"]
assert len(vlmb.sample("sobol", {"start.psi1": (-0.5, -0.4)}, runs=4, seed=1)) == 4

recording = ezc3d.c3d()
recording["parameters"]["POINT"]["RATE"]["value"] = [100.0]
recording["parameters"]["POINT"]["LABELS"]["value"] = ["LKNE"]
recording["parameters"]["POINT"]["UNITS"]["value"] = ["m"]
points = np.ones((4, 1, 50))
points[2, 0] = 0.3 + 0.05 * np.sin(2.0 * np.pi * np.arange(50) / 100.0)
recording["data"]["points"] = points
recording.write("trial.c3d")
leg = {"rod": {"length": 0.5, "mass": 10.0}, "lower": {"motion": "prescribed", "law": "mocap.knee"}, "tip_mass": 4.0}
data = [{"name": "mocap", "file": "trial.c3d", "columns": {"knee": "LKNE.z"}}]
led = vlmb.Scene.from_dict({"base": {"kind": "pivot"}, "links": [leg], "data": data, "start": {"psi1": -1.2}}, folder=".")
assert abs(vlmb.simulate(led, duration=0.3)["mocap.knee"].max() - 0.35) < 1e-3

arm = {"name": "arm", "urdf": "ur_description/urdf/ur5_robot.urdf", "posture": {"shoulder_lift_joint": -1.0}}
fell = vlmb.simulate({"base": {"kind": "pivot"}, "robots": [arm]}, duration=0.1)
assert fell.status == "finished" and abs(fell["balance"]).max() < 1e-6

film = Path("run.mp4")
assert main(["view", "slalom.npz", "--mp4", str(film), "--size", "160", "120", "--fps", "10"]) == 0 and film.stat().st_size > 1000
print("every extra works")
