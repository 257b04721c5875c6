"""The live view: a page that is open while a run is computed, and shows the motion at real time as far as it is known.

The run itself is not disturbed. Beside it the same scene is computed once more in short pieces, each from the end of the one
before it; the page plays these, and gets the run's own motion when it is there.
"""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Mapping
from typing import Any
from urllib.parse import parse_qs

import numpy as np
from numpy.typing import NDArray

from vlmb.errors import VlmbError
from vlmb.scene.scene import Scene
from vlmb.simulation.simulate import check, run_options, simulate
from vlmb.simulation.trajectory import Trajectory
from vlmb.views.page import facts, packed, page
from vlmb.views.sceneries import of_samples, of_state, of_trajectory
from vlmb.views.view import FPS, View, serve
from vlmb.views.visual_model import Scenery

Array = NDArray[np.float64]

PIECE = 0.5  # [s] of motion that is computed in one go
AHEAD = 3.0  # [s] of motion that is known before it is shown; no more, since the run needs the processor
CLOSED = 20.0  # [s] that the end of a run waits for a piece under way


class Live:
    """A view of a run under way: made before it, told its trajectory at its end. `changes` are arguments of `simulate`."""

    def __init__(
        self, scene: Scene, changes: Mapping[str, Any] | None = None, t0: float = 0.0, browser: bool | None = None, port: int = 0
    ) -> None:
        self.scene, self.t0 = scene, t0
        self.changes = {key: value for key, value in (changes or {}).items() if value is not None and key != "duration"}
        self.duration = run_options(scene, **dict(changes or {})).duration
        checked = check(scene)
        self.mechanism, start = checked.mechanism, checked.start
        self.lock, self.over = threading.Lock(), threading.Event()
        self.version, self.scenery, self.done, self.note = 0, of_state(self.mechanism, start.state), False, "computing ..."
        self.view: View = serve(page(self.scenery, until=self.duration), browser, port, self.answer)
        self.thread = threading.Thread(target=self._pieces, daemon=True)
        self.thread.start()

    def answer(self, query: str) -> str:
        """Answer a page that has a version of the motion: JSON with a newer one, if there is one."""
        have = int(parse_qs(query).get("have", ["0"])[0])
        with self.lock:
            version, scenery, done, note = self.version, self.scenery, self.done, self.note
        if version <= have:
            return json.dumps({"note": note})
        until = None if done else self.duration
        return json.dumps({"version": version, "note": note, "commands": packed(scenery), "info": facts(scenery, until=until)})

    def finish(self, trajectory: Trajectory) -> View:
        """Show the run itself, from now on; return the view."""
        self.over.set()
        self.thread.join(CLOSED)
        scenery = of_trajectory(trajectory, FPS)
        with self.lock:
            self.version, self.scenery, self.done = self.version + 1, scenery, True
            self.note = "" if trajectory.status == "finished" else trajectory.message
        self.view.text = page(scenery)
        return self.view

    def close(self) -> None:
        """Stop computing and serving."""
        self.over.set()
        self.view.close()

    def _show(self, scenery: Scenery) -> None:
        with self.lock:
            if not self.over.is_set():
                self.version, self.scenery = self.version + 1, scenery
                self.note = f"computed to {scenery.t[-1]:.1f} s"

    def _pieces(self) -> None:
        """Compute piece after piece, a little ahead of real time, until the run is done, or a piece does not end as it should."""
        began, reached, start = time.monotonic(), 0.0, None
        t, q, v = np.zeros(0), np.zeros((0, self.mechanism.model.nq)), np.zeros((0, self.mechanism.model.nv))
        while reached < self.duration - 1e-9 and not self.over.is_set():
            length = min(PIECE, self.duration - reached)
            samples = self.t0 + reached + np.linspace(0.0, length, max(2, round(length * FPS) + 1))
            try:
                piece = simulate(self.mechanism, length, t_eval=samples, start=start, t0=self.t0 + reached, **self.changes)
            except VlmbError:
                return  # the run itself will say it
            known = len(t) > 0
            t, q, v = (np.concatenate([old, new[known:]]) for old, new in ((t, piece.t), (q, piece.q), (v, piece.v)))
            self._show(of_samples(self.mechanism, t, q, v))
            if piece.status != "finished":
                return
            reached, start = reached + length, piece.end
            self.over.wait(max(0.0, reached - AHEAD - (time.monotonic() - began)))
