"""A mechanism of links as MJCF, the scene format of MuJoCo: bodies, joints, masses, the springs of segments, a start.

What has no counterpart there is told: laws, equations, programmes, springs between links. A ski is refused: MuJoCo has no
constraint of velocities alone, and without its knife edge it would be another mechanism.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from xml.sax.saxutils import quoteattr

import numpy as np

from vlmb.errors import SceneError
from vlmb.model.layout import State
from vlmb.model.mechanism import Mechanism, start_length
from vlmb.scene.places import on_rod
from vlmb.scene.tables import BASE, Link

STEP = 2e-4  # [s] of the fourth-order method, for one second within a micrometre
LEAST = 2e-15  # [kg, kg m^2] MuJoCo refuses less of what moves
SHARE = 1e-14  # inertia of a point mass over its mass [m^2]
THICK = 0.02  # [m] radius of rods as they are drawn


def mjcf(mechanism: Mechanism, state: State | None = None) -> str:
    """Return the XML text; `state` becomes the key frame "start". Raises SceneError for a ski and for prescribed segments."""
    scene = mechanism.scene
    if scene.base.kind == "ski":
        raise SceneError(
            "base.kind = 'ski': MuJoCo has no constraint of velocities alone, so no knife edge: export a scene on a pivot or free"
        )
    for at, link in enumerate(scene.links):
        if "prescribed" in (link.lower.motion, link.upper.motion):
            raise SceneError(f"links[{at}]: a prescribed segment has no counterpart in MuJoCo; make it free or fixed")
    lines = [f"<mujoco model={quoteattr(scene.name)}>", *_header(mechanism), "  <worldbody>"]
    lines += [f"    {line}" for line in _Writer(mechanism).lines()]
    lines += ["  </worldbody>"]
    if state is not None:
        q, v = _in_its_order(mechanism, state)
        lines += ["  <keyframe>", f'    <key name="start" qpos="{_numbers(q)}" qvel="{_numbers(v)}"/>', "  </keyframe>"]
    return "\n".join([*lines, "</mujoco>", ""])


def left_behind(mechanism: Mechanism) -> list[str]:
    """Return what of a scene MJCF does not say here."""
    scene = mechanism.scene
    entries = (
        ("constraints", scene.constraints), ("programme", scene.programme or scene.programmes), ("forces", scene.forces),
        ("springs", scene.springs),
        ("contacts", scene.contacts), ("massless legs", scene.legs), ("events", scene.events),
        ("limits of segments", any(link.segment(k).limits for link in scene.links for k in (1, 2))),
    )  # fmt: skip
    return [f"{what}: not in the MJCF" for what, given in entries if given]


def _header(mechanism: Mechanism) -> Iterator[str]:
    yield '  <compiler angle="radian" autolimits="true" inertiafromgeom="false"/>'
    gravity = _numbers(mechanism.scene.surface_gravity)
    yield f'  <option timestep="{STEP:g}" integrator="RK4" gravity="{gravity}"><flag contact="disable"/></option>'


class _Writer:
    """Writes bodies depth-first, as the model has its joints, with no recursion: chains may be long."""

    def __init__(self, mechanism: Mechanism) -> None:
        self.mechanism, self.scene = mechanism, mechanism.scene
        self.children: dict[tuple[str, str], list[int]] = {}
        places = {link.name: link for link in self.scene.links}
        self.at: dict[int, float] = {}
        for i, link in enumerate(self.scene.links):
            along = None if link.parent == BASE else on_rod(places[link.parent], link.parent_point)
            self.children.setdefault((link.parent, "tip" if along is None else "rod"), []).append(i)
            if along is not None:
                self.at[i] = along
        for hanging in self.children.values():
            hanging.sort(key=lambda i: self.at.get(i, 0.0))

    def lines(self) -> Iterator[str]:
        """Yield the bodies' lines."""
        base, closing = self.scene.base, list[str]()
        if base.kind == "free":
            yield '<body name="base">'
            for axis in "xz" if self.scene.plane else "xyz":
                yield f'  <joint name="{axis}" type="slide" axis="{_numbers([float(axis == a) for a in "xyz"])}"/>'
            yield f"  {_inertial(base.mass, 0.0, (0.0, 0.0, 0.0))}"
            closing = ["</body>"]
        stack: list[int | str] = [*reversed(closing), *reversed(self.children.get((BASE, "tip"), []))]
        while stack:
            entry = stack.pop()
            if isinstance(entry, str):
                yield entry
            else:
                yield from self._link(entry, stack)

    def _link(self, i: int, stack: list[int | str]) -> Iterator[str]:
        """Yield the opening lines of a link; what hangs on it, and the closing lines, go onto the stack."""
        link, index = self.scene.links[i], self.mechanism.layout.links[i]
        lower, upper = (start_length(self.scene, link.segment(k), f"links[{i}]") for k in (1, 2))
        start = 0.0 if index.lower.joint else lower  # of the rod in its own body
        yield f'<body name="{link.name}" pos="{_numbers(self._hinge(i))}">'
        turn = 'type="hinge" axis="0 -1 0"' if self.scene.plane else 'type="ball"'
        yield f'  <joint name="{link.name}" {turn}/>'
        if index.lower.joint:
            yield f"  {_slide(link, 1)}"
        transverse = link.rod.transverse_inertia
        tip = start + link.rod.length + upper
        if index.upper.joint:
            yield f"  {_inertial(link.rod.mass, transverse, (start + link.rod.centre, 0.0, 0.0))}"
        else:
            mass = link.rod.mass + link.tip_mass
            centre = (link.rod.mass * (start + link.rod.centre) + link.tip_mass * tip) / mass if mass else start
            apart = link.rod.mass * (start + link.rod.centre - centre) ** 2 + link.tip_mass * (tip - centre) ** 2
            yield f"  {_inertial(mass, transverse + apart, (centre, 0.0, 0.0))}"
        if link.rod.length:
            ends = _numbers([start, 0.0, 0.0, start + link.rod.length, 0.0, 0.0])
            yield f'  <geom type="capsule" fromto="{ends}" size="{THICK}" contype="0" conaffinity="0"/>'
        closing: list[int | str] = ["</body>", *reversed(self.children.get((link.name, "rod"), []))]
        hanging = list[int | str](reversed(self.children.get((link.name, "tip"), [])))
        if index.upper.joint:
            end = _numbers([start + link.rod.length, 0.0, 0.0])
            opening = [f'<body name="{link.name}.upper" pos="{end}">', f"  {_slide(link, 2)}"]
            opening.append(f"  {_inertial(link.tip_mass, 0.0, (0.0, 0.0, 0.0))}")
            stack += [*closing, "</body>", *hanging, *reversed(opening)]
        else:
            stack += [*closing, *hanging]

    def _hinge(self, i: int) -> tuple[float, float, float]:
        """Return where a link's hinge is in the body that it hangs on."""
        link = self.scene.links[i]
        if link.parent == BASE:
            return link.anchor or (0.0, 0.0, 0.0)
        at = next(k for k, entry in enumerate(self.scene.links) if entry.name == link.parent)
        parent, index = self.scene.links[at], self.mechanism.layout.links[at]
        start = 0.0 if index.lower.joint else start_length(self.scene, parent.lower, f"links[{at}]")
        if i in self.at:
            return start + self.at[i], link.aside, 0.0
        if index.upper.joint:
            return 0.0, link.aside, 0.0
        return start + parent.rod.length + start_length(self.scene, parent.upper, f"links[{at}]"), link.aside, 0.0


def _inertial(mass: float, transverse: float, centre: tuple[float, float, float]) -> str:
    """Return a body's mass; a thin rod gets an axial inertia, which any ball-jointed motion without spin does not show."""
    own = max(transverse, SHARE * mass, LEAST)
    return f'<inertial pos="{_numbers(centre)}" mass="{max(mass, LEAST)!r}" diaginertia="{_numbers([own, own, own])}"/>'


def _slide(link: Link, which: int) -> str:
    segment, side = link.segment(which), "lower" if which == 1 else "upper"
    spring = f' stiffness="{segment.stiffness!r}" springref="{segment.rest_length!r}"' if segment.stiffness else ""
    damper = f' damping="{segment.damping!r}"' if segment.damping else ""
    return f'<joint name="{link.name}.{side}" type="slide" axis="1 0 0"{spring}{damper}/>'


def _in_its_order(mechanism: Mechanism, state: State) -> tuple[np.ndarray, np.ndarray]:
    """Return qpos and qvel: the model's own order, quaternions with their real part first."""
    q = np.array(state.q)
    if not mechanism.layout.plane:
        for link in mechanism.layout.links:
            q[link.q : link.q + 4] = np.roll(q[link.q : link.q + 4], 1)
    return q, np.array(state.v)


def _numbers(values: Iterable[float]) -> str:
    return " ".join(repr(float(value)) for value in values)
