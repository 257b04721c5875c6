"""The live view: a page that is open while a run is computed, and shows the motion at real time as far as it is known.

The run hands out its samples as it takes them, `simulate(..., watch=live.take)`; what a page sees of them is made when it asks.
"""

from __future__ import annotations

import json
import threading
from collections.abc import Mapping
from typing import Any
from urllib.parse import parse_qs

import numpy as np
from numpy.typing import NDArray

from vlmb.scene.scene import Scene
from vlmb.simulation.checking import check
from vlmb.simulation.simulate import run_options
from vlmb.simulation.trajectory import Trajectory
from vlmb.views.page import facts, packed, page
from vlmb.views.sceneries import of_samples, of_state, of_trajectory
from vlmb.views.view import FPS, View, serve

Array = NDArray[np.float64]


class Live:
    """A view of a run under way: made before it, told its trajectory at its end. `changes` are arguments of `simulate`."""

    def __init__(
        self, scene: Scene, changes: Mapping[str, Any] | None = None, browser: bool | None = None, port: int = 0
    ) -> None:
        self.duration = run_options(scene, **dict(changes or {})).duration
        checked = check(scene)
        self.mechanism, start = checked.mechanism, checked.start
        self.lock, self.drawing = threading.Lock(), threading.Lock()
        self.samples: list[tuple[Array, Array, Array]] = []  # t, q, v as the run hands them out
        self.shown = 0  # entries of it that the scenery has
        self.version, self.scenery, self.done, self.note = 0, of_state(self.mechanism, start.state), False, "computing ..."
        self.view: View = serve(page(self.scenery, until=self.duration), browser, port, self.answer)
    def take(self, t: Array, q: Array, v: Array) -> None:
        """Take samples of the run: t (N,) [s], q (N, nq), v (N, nv)."""
        with self.lock:
            self.samples.append((np.array(t), np.array(q), np.array(v)))

    def answer(self, query: str) -> str:
        """Answer a page that has a version of the motion: JSON with a newer one, if there is one."""
        have = int(parse_qs(query).get("have", ["0"])[0])
        self._grow()
        with self.lock:
            version, scenery, done, note = self.version, self.scenery, self.done, self.note
        if version <= have:
            return json.dumps({"note": note})
        until = None if done else self.duration
        return json.dumps({"version": version, "note": note, "commands": packed(scenery), "info": facts(scenery, until=until)})

    def finish(self, trajectory: Trajectory) -> View:
        """Show the run itself, from now on; return the view."""
        scenery = of_trajectory(trajectory, FPS)
        with self.lock:
            self.version, self.scenery, self.done = self.version + 1, scenery, True
            self.note = "" if trajectory.status == "finished" else trajectory.message
        self.view.text = page(scenery)
        return self.view

    def close(self) -> None:
        """Stop serving."""
        self.view.close()

    def _grow(self) -> None:
        """Let the scenery have all samples that there are."""
        with self.drawing:
            with self.lock:
                samples, done = self.samples[:], self.done
            if done or len(samples) == self.shown:
                return
            t, q, v = (np.concatenate(parts) for parts in zip(*samples, strict=True))
            scenery = of_samples(self.mechanism, t, q, v)
            with self.lock:
                self.samples[: len(samples)] = [(t, q, v)]
                self.shown = 1
                if not self.done:
                    self.version, self.scenery = self.version + 1, scenery
                    self.note = f"computed to {t[-1]:.1f} s"
