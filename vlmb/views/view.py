"""The view: a posture or a motion in the browser, as one HTML file, as stills, as an animated GIF, in a notebook.

`play(trajectory)` opens a browser; `export_html(trajectory, "run.html")` writes one file to send.
"""

from __future__ import annotations

import errno
import os
import sys
import threading
import webbrowser
from collections.abc import Callable
from contextlib import suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from vlmb.errors import VlmbError
from vlmb.model.mechanism import Mechanism
from vlmb.simulation.checking import check
from vlmb.simulation.files import write_text
from vlmb.simulation.trajectory import Trajectory
from vlmb.studies.modes import Mode
from vlmb.views.page import page
from vlmb.views.sceneries import ends_of_mode, of_mode, of_state, of_trajectory
from vlmb.views.stills import Shot, still
from vlmb.views.visual_model import Scenery

if TYPE_CHECKING:
    from PIL.Image import Image

    from vlmb.model.robot_mechanism import RobotMechanism

    Shown = Mechanism | RobotMechanism

__all__ = ["FPS", "Shot", "View", "export_html", "picture", "play", "posture", "serve", "show"]

FPS = 60.0
WITHOUT = "write a file with export_html (--html), a picture with --png, or serve only with --no-browser"


class View:
    """A page that this process serves to browsers of this machine until `close`; in a notebook it shows itself.

    `more(query)` answers what a page asks for whose motion is still being computed: JSON.
    """

    def __init__(self, text: str, port: int = 0, more: Callable[[str], str] | None = None) -> None:
        view = self

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                path, _, query = self.path.partition("?")
                found = path in ("/", "/index.html")
                content, kind = (view.text, "text/html") if found else ("", "text/plain")
                if path == "/more" and more is not None:
                    found, content, kind = True, more(query), "application/json"
                sent = content.encode("utf-8")
                self.send_response(200 if found else 404)
                self.send_header("Content-Type", f"{kind}; charset=utf-8")
                self.send_header("Cache-Control", "no-store")
                self.send_header("Content-Length", str(len(sent)))
                self.end_headers()
                with suppress(ConnectionError):  # a page that was closed meanwhile
                    self.wfile.write(sent)

            def log_message(self, *_: Any) -> None:
                pass

        try:
            self.server = ThreadingHTTPServer(("127.0.0.1", port), Handler)
        except (OSError, OverflowError) as error:
            busy = isinstance(error, OSError) and error.errno == errno.EADDRINUSE
            why = "is in use by another program" if busy else f"cannot be opened ({error})"
            raise VlmbError(f"port {port} {why}: choose another, or 0 for any free one") from None
        self.server.daemon_threads = True
        self.text, self.url = text, f"http://127.0.0.1:{self.server.server_address[1]}/"
        self.thread = threading.Thread(target=self.server.serve_forever, daemon=True)
        self.thread.start()

    def open(self) -> View:
        """Open a browser on the page. Raises VlmbError where none can be opened."""
        need_display()
        try:
            opened = webbrowser.open(self.url)
        except webbrowser.Error:
            opened = False
        if not opened:
            raise VlmbError(f"no browser could be opened: {WITHOUT}, or open {self.url} yourself")
        return self

    def wait(self) -> None:
        """Serve until the user presses Ctrl-C."""
        try:
            self.thread.join()
        except KeyboardInterrupt:
            self.close()

    def close(self) -> None:
        """Stop serving; a page that is open stays as it is."""
        self.server.shutdown()
        self.server.server_close()

    def _repr_html_(self) -> str:
        return frame_html(self.text)


def show(
    mechanism: Shown, state: tuple[Any, Any] | None = None, arrows: bool = False, browser: bool | None = None, port: int = 0
) -> View:
    """Show a posture (default: the start of the scene) in a browser; a notebook shows the returned view itself.

    Raises VlmbError when meshcat is not installed, the port is in use, or no browser can be opened.
    """
    return serve(page(posture(mechanism, state, arrows)), browser, port)


def play(
    trajectory: Trajectory | Mode, speed: float = 1.0, fps: float = FPS, arrows: bool = False, programme: Any = None,
    browser: bool | None = None, port: int = 0,
) -> View:  # fmt: skip
    """Play a motion, or a mode, in a browser, with pause, speed and scrubbing; `programme` (n, 2) [m] is drawn dashed.

    Raises VlmbError as `show` does.
    """
    made = of_mode(trajectory) if isinstance(trajectory, Mode) else of_trajectory(trajectory, fps, arrows, programme)
    return serve(page(made, speed), browser, port)


def export_html(
    what: Trajectory | Mode | Shown, path: str | Path, fps: float = FPS, speed: float = 1.0, arrows: bool = False,
    programme: Any = None,
) -> Path:  # fmt: skip
    """Write one HTML file that plays a motion or a mode (or shows a start posture) anywhere, without a connection."""
    if isinstance(what, Mode):
        return write_text(path, page(of_mode(what), speed))
    made = of_trajectory(what, fps, arrows, programme) if isinstance(what, Trajectory) else posture(what, None, arrows)
    return write_text(path, page(made, speed))


def picture(
    what: Trajectory | Mode | Shown, time: float | None = None, size: tuple[int, int] = (960, 600), ghosts: int = 0,
    arrows: bool = False, programme: Any = None, since: float | None = None, view_from: tuple[float, float, float] | None = None,
    shot: Shot | None = None,
) -> Image:  # fmt: skip
    """Paint a motion at a time [s] (default: its end), with earlier postures; or a start posture, or a mode. No screen.

    Of a mode it is the steady posture, and paler both ends of the swing, from where most is seen of it.

    `shot=vlmb.view.Shot(azimuth=-60, elevation=15, zoom=1.5)` [deg], `Shot(side=True)`, `Shot(follow=True)` place the camera.
    """
    if isinstance(what, Mode):
        made = ends_of_mode(what)
        return still(made, 2.0, size, 2, 0.0, view_from or (_across(made) if shot is None else None), shot)
    made = of_trajectory(what, FPS, arrows, programme) if isinstance(what, Trajectory) else posture(what, None, arrows)
    if isinstance(what, Trajectory) and time is not None and not what.t[0] <= time <= what.t[-1]:
        raise VlmbError(f"time {time:g} s: the motion lasts from {what.t[0]:g} to {what.t[-1]:g} s")
    return still(made, time, size, ghosts, since, view_from, shot)


def _across(ends: Scenery) -> tuple[float, float, float] | None:
    """Return a direction to the camera across what moves most between the ends of a mode; None where nothing goes sideways."""
    one, other = ends.poses(0), ends.poses(1)
    moved = np.array([(ends.turn @ (one[path] - other[path])[:3, 3])[:2] for path in one])
    ahead = np.linalg.svd(moved)[2][0]
    if not np.abs(moved).max(initial=0.0) > 1e-2 * ends.radius:
        return None
    side = -1.0 if ahead[0] > 0.0 or (ahead[0] == 0.0 and ahead[1] > 0.0) else 1.0
    return float(-side * ahead[1]), float(side * ahead[0]), 0.3


def posture(mechanism: Shown, state: tuple[Any, Any] | None = None, arrows: bool = False) -> Scenery:
    """Return the scenery of a posture; without a state, of the start of the scene."""
    if state is None:
        state = check(mechanism).start.state
    return of_state(mechanism, state, arrows)


def frame_html(text: str, height: int = 480) -> str:
    """Put a page into a frame of a notebook."""
    escaped = text.replace("&", "&amp;").replace('"', "&quot;")
    return f'<iframe srcdoc="{escaped}" style="width: 100%; height: {height}px; border: none"></iframe>'


def has_display() -> bool:
    """Say whether a browser window could appear (text browsers do not count)."""
    if sys.platform in ("win32", "darwin") or os.environ.get("BROWSER"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def need_display() -> None:
    """Raise VlmbError where no browser window could appear."""
    if not has_display():
        raise VlmbError(f"there is no display here to open a browser on: {WITHOUT}")


def keep(view: View) -> None:
    """Say where a page is, and serve it until the user presses Ctrl-C."""
    print(f"{view.url} (Ctrl-C ends)", flush=True)
    view.wait()


def serve(text: str, browser: bool | None, port: int, more: Callable[[str], str] | None = None) -> View:
    """Serve a page, and open a browser on it: by default everywhere but in a notebook."""
    view = View(text, port, more)
    try:
        return view.open() if ("ipykernel" not in sys.modules if browser is None else browser) else view
    except VlmbError:
        view.close()
        raise
