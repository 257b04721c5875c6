"""Random scenes of every kind, told in other words: turned, mirrored, later, heavier, larger, in another order. One motion."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

import vlmb

Array = NDArray[np.float64]
Scene = dict[str, Any]

DURATION, HALF = 0.6, 0.3  # [s]
SAMPLES = 200 / DURATION  # [1/s] at least so many
TIGHT = {"rtol": 1e-10, "atol": 1e-11}
NUDGE = 1e-7  # [rad] of a start that tells how fast errors grow
ALLOWED = 3e-8  # [m] of a motion of metres, times the growth of a disturbed start
NAMED = ("two motions meet",)  # stops that rounding decides: near singular postures
SIDE_BY_SIDE = 1e-9  # a stop in time, over the duration, times that growth


@dataclass(frozen=True)
class Words:
    """How a scene is told: none of it changes the motion but for its units and its place."""

    turn: float = 0.0  # [rad] about the vertical
    mirror: float = 1.0  # -1: left and right change places
    shift: float = 0.0  # [s] later
    mass: float = 1.0  # times heavier, all forces with it
    length: float = 1.0  # times larger, slower by its root
    order: int = 0  # how links are listed
    run: tuple[tuple[str, Any], ...] = ()  # changes of [run]
    nudge: float = 0.0  # [rad] of the first link

    @property
    def time(self) -> float:
        """Times longer."""
        return math.sqrt(self.length)


def make(seed: int, words: Words = Words()) -> Scene:
    """Make a scene; the same seed and other words make the same motion."""
    dice = np.random.default_rng(seed)
    big, heavy, slow = words.length, words.mass, words.time
    kind, plane = str(dice.choice(["pivot", "free", "ski"])), bool(dice.random() < 0.25)
    count = int(dice.integers(1, 4))
    at = f"(t - {words.shift!r})/{slow!r}"
    force, stiff, damped = heavy, heavy / big, heavy / slow  # m g, over a length, over a velocity
    links, start = [], {}
    first = 0.0

    def segment(above: bool) -> Scene | None:
        way, long, wave = dice.random(), float(dice.uniform(0.1, 0.4)), float(dice.uniform(2.0, 8.0))
        stiffness, damping = float(dice.uniform(500.0, 3000.0)), float(dice.uniform(0.0, 5.0))
        if way < 0.3:
            return {"length": long * big, "stiffness": stiffness * stiff, "damping": damping * damped}
        if way < 0.5:
            return {"motion": "prescribed", "law": f"{long * big!r} + {0.04 * big!r}*sin({wave!r}*{at})"}
        return {"motion": "fixed", "length": long * big} if way < 0.7 else None

    for i in range(count):
        name = "abc"[i]
        length, mass = float(dice.uniform(0.3, 0.8)), float(dice.uniform(0.5, 3.0))
        link: Scene = {"name": name, "rod": {"length": length * big, "mass": mass * heavy}}
        link["tip_mass"] = float(dice.uniform(0.3, 1.0)) * heavy
        for where in ("lower", "upper"):
            made = segment(where == "upper")
            if made is not None:
                link[where] = made
        parent, point = int(dice.integers(0, i)) if i else -1, str(dice.choice(["tip", "rod_end", "rod_start"]))
        link["parent"] = "abc"[parent] if i else "base"
        if i and dice.random() < 0.4:
            link["parent_point"] = point
        links.append(link)
        low = 0.8 if kind == "ski" else -1.2
        elevation, azimuth = float(dice.uniform(low, 1.2)), float(dice.uniform(-2.0, 2.0))
        turning = dice.uniform(-1.0, 1.0, 2)
        start[f"{name}.elevation"], start[f"{name}.elevation_dot"] = elevation, float(turning[0]) / slow
        if not plane:
            start[f"{name}.azimuth"] = words.mirror * azimuth + words.turn
            start[f"{name}.azimuth_dot"] = words.mirror * float(turning[1]) / slow
        first = elevation if i == 0 else first
    base: Scene = {"kind": kind}
    speeds, inertia = dice.uniform(-1.0, 1.0, 3), float(dice.uniform(0.5, 2.0))
    slope = 0.15 if dice.random() < 0.5 else 0.0
    if kind == "ski":
        base |= {"mass": 5.0 * heavy, "inertia": inertia * heavy * big**2, "com_offset": 0.1 * big}
        start |= {"phi0": words.mirror * 0.3 + words.turn, "phi0_dot": words.mirror * float(speeds[0]) / slow}
        start["speed"] = 3.0 * big / slow
    elif kind == "free":
        base["mass"] = heavy
        along, aside = speeds[0] * math.cos(words.turn), speeds[0] * math.sin(words.turn)
        start |= {"x_dot": float(along) * big / slow, "z_dot": float(speeds[2]) * big / slow}
        if plane:
            start["x_dot"] = float(speeds[0]) * big / slow
        else:
            start["y_dot"] = float(aside) * big / slow
    start["a.elevation"] += words.nudge
    listed = ordered(links, words.order)
    number = {link["name"]: k for k, link in enumerate(listed, 1)}
    scene: Scene = {"plane": plane, "base": base, "links": listed, "start": start, "forces": [], "gravity": 9.81}
    if kind == "ski":
        scene["slope"] = slope
    torque, choice = force * big, dice.random(4)
    if choice[0] < 0.4:
        scene["forces"].append({"on": f"M_psi{number['a']}", "law": f"{2.0 * torque!r}*sin(5*{at})"})
    if choice[1] < 0.3:
        law = f"-{0.5 * torque * slow!r}*a.elevation_dot"
        scene["forces"].append({"on": f"M_psi{number['a']}", "law": law})
    if count > 1 and choice[2] < 0.5:
        child = links[1]
        scene["forces"].append(
            {"between": [child["parent"], child["name"]], "stiffness": 20.0 * torque, "damping": 0.5 * torque * slow}
        )
    if choice[3] < 0.25:
        scene["constraints"] = [f"a.elevation = {first!r} + 0.2*sin(2*{at})"]
        start["a.elevation_dot"] = 0.4 / slow
    elif choice[3] < 0.45:
        scene["programme"] = {
            "constraints": [f"a.elevation = {first - 0.05!r} + 0.2*sin(2*{at})"], "controls": [f"M_psi{number['a']}"],
            "frequency": 4.0 / slow,
        }  # fmt: skip
        scene["forces"] = [entry for entry in scene["forces"] if "on" not in entry]
    _act(scene, seed, words, {link["name"] for link in links}, number["a"], number.get("b"))
    scene["run"] = {"gain": 5.0 / slow, "duration": DURATION * slow, "samples": 60.0 / slow, **TIGHT, **dict(words.run)}
    scene["run"]["atol"] *= min(1.0, big)
    return scene


def _act(scene: Scene, seed: int, words: Words, names: set[str], first: int, second: int | None) -> None:
    """Put forces at points, springs between points, drag, friction and gains of the motion on a scene; dice of their own."""
    dice, big, heavy, slow = np.random.default_rng([seed, 2]), words.length, words.mass, words.time
    last, stiff, damped, force = max(names), heavy / big, heavy / slow, heavy
    springs: list[Scene] = []

    def place() -> list[float]:
        x, y, z = dice.uniform([0.2, -0.5, 0.8], [1.0, 0.5, 1.5]).tolist()
        x, y = (x, 0.0) if scene["plane"] else (x, words.mirror * y)
        c, s = math.cos(words.turn), math.sin(words.turn)
        return [(c * x - s * y) * big, (s * x + c * y) * big, z * big]

    chosen, size = dice.random(8), dice.uniform(0.5, 1.5, 8).tolist()
    if chosen[0] < 0.3:
        keys = {"stiffness": 40.0 * size[0] * stiff, "damping": 2.0 * size[1] * damped, "rest": 0.3 * size[2] * big}
        springs.append({"between": [f"{last}.tip", place()], **keys})
    if chosen[1] < 0.25:
        rope = {"stiffness": 60.0 * size[3] * stiff, "rest": 0.5 * size[4] * big, "tension_only": True}
        springs.append({"between": [place(), "a.rod_end"], **rope})
    if springs:
        scene["springs"] = springs
    if chosen[2] < 0.25:
        scene["forces"].append({"at": f"{last}.tip", "force": [f"-{size[5] * damped!r}*{last}.tip.{axis}_dot" for axis in "xyz"]})
    if chosen[3] < 0.25:
        scene["forces"].append({"at": "a.rod_end", "force": [f"{3.0 * size[6] * force!r}*cos(a.elevation)", 0, 0], "frame": "a"})
    if scene["base"]["kind"] == "ski":
        if chosen[4] < 0.4:
            scene["base"] |= {"drag": 0.3 * size[7] * heavy / big, "drag_at": "com" if chosen[4] < 0.2 else f"{last}.tip"}
        if chosen[5] < 0.3:
            scene["base"]["friction"] = 0.05
    if "programme" in scene and chosen[6] < 0.7:
        programme = scene["programme"]
        del programme["frequency"]
        programme["h"] = [[f"-{16.0 / slow**2!r}*(1 + 0.3*a.elevation**2)"]]
        programme["k"] = [[f"-{8.0 / slow!r}*(1 + 0.2*sin(a.elevation)) - 0.1*abs(a.elevation_dot)"]]
        if second is not None and chosen[7] < 0.6:
            programme["controls"].append(f"M_psi{second}")
            weight = f"{(heavy * big) ** -2!r}*(1 + 0.5*sin(a.elevation))"
            programme["weights"] = {f"M_psi{first}": weight, f"M_psi{second}": f"2*{weight}"}


def ordered(links: list[Scene], order: int) -> list[Scene]:
    """List parents before children, in one of the ways there are."""
    dice, listed, left = np.random.default_rng(order), [], list(links)
    while left:
        names = {"base", *(link["name"] for link in listed)}
        ready = [link for link in left if link["parent"] in names]
        chosen = ready[int(dice.integers(len(ready)))] if order else ready[0]
        listed.append(chosen)
        left.remove(chosen)
    return listed


Maker = Callable[[int, Words], Scene]


class Motion(NamedTuple):
    """Where the tips are, in the first scene's units and place, and how it ended."""

    t: Array
    points: Array  # (N, links, 3) [m]
    status: str
    message: str
    doubtful: bool = False


def seen(trajectory: vlmb.Trajectory, words: Words) -> Motion:
    """Take a motion back to the words of the first scene."""
    names = sorted(link.name for link in trajectory.mechanism.layout.links)
    points = np.stack([trajectory.position(name, "tip") for name in names], axis=1) / words.length
    c, s = math.cos(words.turn), math.sin(words.turn)
    back = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    points = points @ back.T
    points[..., 1] *= words.mirror
    t = (trajectory.t - words.shift) / words.time
    on = np.abs(t * SAMPLES - np.round(t * SAMPLES)) < 1e-7 if trajectory.scene.contacts else slice(None)  # not those of an event
    return Motion(t[on], points[on], trajectory.status, trajectory.message, bool(trajectory.doubts))


def run(seed: int, words: Words = Words(), maker: Maker = make) -> Motion:
    """Simulate a scene told in some words."""
    return seen(vlmb.simulate(maker(seed, words), t0=words.shift), words)


def tellings(seed: int, maker: Maker = make) -> dict[str, Words]:
    """List the words that a scene is told in beside the plain ones."""
    scene, dice = maker(seed, Words()), np.random.default_rng([seed, 1])
    found = {
        "later": Words(shift=float(dice.uniform(0.5, 3.0))),
        "heavier": Words(mass=float(10.0 ** dice.uniform(-1.0, 1.0))),
        "larger": Words(length=float(10.0 ** dice.uniform(-0.5, 0.5))),
        "in another order": Words(order=7),
        "by the other engine": Words(run=(("engine", "pinocchio"),)),
        "by adams": Words(run=(("method", "adams"),)),
    }
    ski, plane = scene["base"]["kind"] == "ski", scene["plane"]
    if not scene.get("slope") and (ski or not plane):
        found["turned"] = Words(turn=float(dice.uniform(-2.0, 2.0)))
    if (ski or not plane) and not scene["start"].get("y_dot"):
        found["mirrored"] = Words(mirror=-1.0)
    if ski:
        found |= {form: Words(run=(("knife_edge", form),)) for form in ("multiplier", "projection")}
    return found


class Verdict(NamedTuple):
    """What a telling came to: right, said, or wrong with what is off; and how long its run took [s]."""

    name: str
    word: str
    why: str
    seconds: float


def judge(seed: int, folder: Path, maker: Maker = make) -> tuple[str, list[Verdict]]:
    """Tell a scene in all words; return "" or why it was refused, and the verdicts."""
    began = time.perf_counter()
    try:
        trajectory = vlmb.simulate(maker(seed, Words()))
    except vlmb.VlmbError as error:
        return str(error), []
    plain = seen(trajectory, Words())
    try:
        nudged = run(seed, Words(nudge=NUDGE), maker)
    except vlmb.VlmbError as error:
        return str(error), []
    both = min(len(plain.t), len(nudged.t))
    growth = 1.0 + float(np.abs(plain.points[:both] - nudged.points[:both]).max()) / NUDGE
    verdicts = [Verdict("plainly", "said" if trajectory.doubts else "right", "", time.perf_counter() - began)]

    def compare(name: str, other: Callable[[], Motion]) -> None:
        start = time.perf_counter()
        try:
            word, why = _compare(plain, other(), growth)
        except vlmb.VlmbError as error:
            word, why = "wrong", f"refused: {error}"
        verdicts.append(Verdict(name, word, why, time.perf_counter() - start))

    for name, words in tellings(seed, maker).items():
        compare(name, lambda words=words: run(seed, words, maker))
    compare("saved and loaded", lambda: seen(vlmb.load_trajectory(trajectory.save(folder / "run.npz")), Words()))
    compare("from the middle", lambda: _in_two(seed, maker))
    return "", verdicts


def _in_two(seed: int, maker: Maker) -> Motion:
    first = vlmb.simulate(maker(seed, Words()), HALF)
    if first.status != "finished":
        return seen(first, Words())
    second = vlmb.simulate(maker(seed, Words()), DURATION - HALF, start=first.end, t0=HALF)
    one, two = seen(first, Words()), seen(second, Words())
    points = np.concatenate([one.points[:-1], two.points])
    return Motion(np.append(one.t[:-1], two.t), points, two.status, two.message, one.doubtful or two.doubtful)


def _compare(plain: Motion, other: Motion, growth: float) -> tuple[str, str]:
    """Say whether two motions are one: at common times, and in how they end."""
    if "failed" in (plain.status, other.status) or any(
        motion.doubtful or any(text in motion.message for text in NAMED) for motion in (plain, other)
    ):
        return "said", other.message
    if plain.status != other.status:
        return "wrong", f"{plain.message} but {other.message}"
    apart = abs(plain.t[-1] - other.t[-1])
    if apart > SIDE_BY_SIDE * growth * 1e3:
        return "wrong", f"ends at {other.t[-1]:.9g} instead of {plain.t[-1]:.9g}"
    count = min(len(plain.t), len(other.t)) - 1
    same = np.abs(plain.t[:count] - other.t[:count]) < 1e-9
    off = float(np.abs(plain.points[:count] - other.points[:count])[same].max())
    size = max(1.0, float(np.abs(plain.points).max()))
    if not off <= ALLOWED * growth * size:
        return "wrong", f"{off:.2e} m off, {ALLOWED * growth * size:.1e} allowed"
    return "right", ""


