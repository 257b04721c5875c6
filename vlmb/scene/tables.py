"""The tables of a scene file: base, links, forces, programme and run, as frozen data."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal, TypeAlias

import msgspec

Positive = Annotated[float, msgspec.Meta(gt=0.0)]
NonNegative = Annotated[float, msgspec.Meta(ge=0.0)]
NAME, MAX_NAME = r"[A-Za-z][A-Za-z0-9_]*", 64
ALLOWED_NAME = f"a name begins with a letter and has letters, digits and _, {MAX_NAME} at most"
Name = Annotated[str, msgspec.Meta(pattern=rf"\A{NAME}\Z", max_length=MAX_NAME)]
Parent = Annotated[str, msgspec.Meta(pattern=rf"\A({NAME}(\.[A-Za-z0-9_./ -]+)?)?\Z", max_length=2 * MAX_NAME)]
Law: TypeAlias = float | str
Place: TypeAlias = str | tuple[float, float, float]  # a point of a link, or a fixed one [m]
SURFACE = "surface"  # the frame of forces that is no link's

BASE = "base"
BOUNCE = "bounce"
FIXED_STEP = ("euler", "rk4", "gauss")
DEFAULT_STEP = 1e-3  # [s]


class Table(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """A table of the scene file: unknown keys are refused."""

    def __hash__(self) -> int:
        return hash(_hashable(self))


def _hashable(value: object) -> object:
    """The same content without dicts and lists, whose order or kind equality does not mind."""
    if isinstance(value, msgspec.Struct):
        return type(value).__name__, *(_hashable(entry) for entry in msgspec.structs.astuple(value))
    if isinstance(value, dict):
        return frozenset((name, _hashable(entry)) for name, entry in value.items())
    return tuple(map(_hashable, value)) if isinstance(value, (list, tuple)) else value


class Base(Table, frozen=True, kw_only=True):
    """What link 1 stands on: a hinge on the ground, a ski on the surface, or nothing."""

    kind: Literal["pivot", "ski", "free"]
    mass: NonNegative = 0.0  # [kg], ski; a point mass at the first hinge of a free base
    inertia: NonNegative = 0.0  # [kg m^2], ski: vertical axis through its centre of mass
    com_offset: float = 0.0  # [m], ski: centre of mass ahead of the knife-edge point
    drag: NonNegative = 0.0  # [kg/m], ski: the air takes drag |v| v
    friction: NonNegative = 0.0  # ski: of Coulomb, along it
    friction_on: Literal["normal", "resultant"] = "normal"  # what it goes by: the normal force, or with the edge force
    width: NonNegative = 0.0  # [m], ski: 0 is not looked at
    length: NonNegative = 0.0  # [m]
    lift: bool = False  # ski: it may leave the snow, which only pushes
    hold: Positive | None = None  # |edge force| <= hold * normal force; default: no limit
    skid: NonNegative | None = None  # the ratio while it skids; default: hold
    drag_at: str = "com"  # whose velocity v is and where it takes it: "com", or a point such as legs.tip


class Rod(Table, frozen=True, kw_only=True):
    """The rigid massive part of a link; thin and uniform unless `com` and `inertia` say otherwise."""

    length: NonNegative  # [m]
    mass: NonNegative  # [kg]
    com: float | None = None  # [m] from the rod's start
    inertia: NonNegative | None = None  # [kg m^2] transverse, about the centre of mass

    @property
    def centre(self) -> float:
        """Distance of the centre of mass from the rod's start [m]; l/2 for the paper's rod."""
        return 0.5 * self.length if self.com is None else self.com

    @property
    def transverse_inertia(self) -> float:
        """Transverse inertia about the centre of mass [kg m^2]; m l^2/12 for the paper's rod, so that (2.4) is m l^2/3."""
        return self.mass * self.length**2 / 12.0 if self.inertia is None else self.inertia


class Segment(Table, frozen=True, kw_only=True):
    """A massless part of a link: free, fixed, or prescribed by a law of time."""

    length: float | None = None  # [m] start value of a free segment, value of a fixed one
    motion: Literal["free", "fixed", "prescribed"] = "free"
    law: Law | None = None  # [m], prescribed
    stiffness: NonNegative = 0.0  # [N/m]
    damping: NonNegative = 0.0  # [N s/m]
    rest: float | None = None  # [m], default: length
    limits: tuple[float, float] | None = None  # [m], default (0, inf)
    at_limit: Literal["end", "bounce"] = "end"  # what happens there: the run ends, or the length strikes a stop
    restitution: Annotated[float, msgspec.Meta(ge=0.0, le=1.0)] = 0.0  # of that stop; 0 holds until the force pulls back

    @property
    def bounds(self) -> tuple[float, float]:
        """Limits [m] of the length; (0, inf) unless given."""
        return self.limits or (0.0, math.inf)

    @property
    def rest_length(self) -> float:
        """Length [m] at which the spring carries no force; the start length unless given."""
        return float((self.length if self.rest is None else self.rest) or 0.0)


class Link(Table, frozen=True, kw_only=True):
    """One variable-length link: lower massless segment, rod, upper massless segment."""

    rod: Rod
    name: Name = ""
    parent: Parent = ""  # "" = the previous link, the base for the first; or a robot's frame, talos.left_foot
    parent_point: Literal["tip", "rod_start", "rod_end"] | float = "tip"  # a number: [m] from the parent's hinge
    anchor: tuple[float, float, float] | None = None  # [m] of a link on the base: ahead, left, up on a ski; a point of the ground
    aside: float = 0.0  # [m] of a link on a link, with `plane`: how far to the left of that place it hangs
    lower: Segment = Segment(length=0.0, motion="fixed")
    upper: Segment = Segment(length=0.0, motion="fixed")
    tip_mass: NonNegative = 0.0  # [kg]

    def segment(self, which: int) -> Segment:
        """Return the lower (1) or upper (2) segment."""
        return self.lower if which == 1 else self.upper


class Force(Table, frozen=True, kw_only=True):
    """A generalized force by name and law, a force at a point, or a spring-damper between the directions of two links."""

    on: str | None = None
    law: Law | None = None
    at: str | None = None  # a point: legs.tip
    force: tuple[Law, Law, Law] | None = None  # [N] at that point, by its components in `frame`
    frame: str = SURFACE  # or a link's name: along it, azimuthal, elevational
    between: tuple[str, str] | None = None
    stiffness: NonNegative = 0.0  # [N m/rad]
    damping: NonNegative = 0.0  # [N m s/rad]
    rest: float = 0.0  # [rad], angle between the two directions
    closed: tuple[str, ...] = ()  # contacts: it acts while all of these are closed
    open: tuple[str, ...] = ()  # and all of these open; default: always


class Spring(Table, frozen=True, kw_only=True):
    """A spring-damper along the line between two points: of links, or fixed ones."""

    between: tuple[Place, Place]
    stiffness: NonNegative = 0.0  # [N/m]
    damping: NonNegative = 0.0  # [N s/m]
    rest: NonNegative = 0.0  # [m]
    tension_only: bool = False  # a rope: it pulls, and never pushes


class Contact(Table, frozen=True, kw_only=True):
    """A point that may touch a surface."""

    point: str  # legs.tip; "base" is the first hinge of a free base
    name: str = ""  # default: the point
    surface: str = "z"  # 0 on it, positive outside; of the point's x, y, z, of t and parameters
    surface_velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)  # [m/s]
    friction: NonNegative | Literal["rough"] = "rough"  # of Coulomb; rough never slips while it pushes
    friction_static: NonNegative | None = None  # of a point that does not slip; default: friction
    restitution: Annotated[float, msgspec.Meta(ge=0.0, le=1.0)] = 0.0
    when: str = ""  # one comparison: it touches only where this is true at the crossing; default: always

    @property
    def slips(self) -> bool:
        """Whether friction is finite and more than nothing, so that sliding takes energy."""
        return self.friction not in ("rough", 0.0)


class Leg(Table, frozen=True, kw_only=True):
    """A massless leg: nothing while it swings, a push along foot -> point while it stands on z = 0."""

    from_: str = msgspec.field(name="from")  # legs.tip; "base" is the first hinge of a free base
    name: Name = ""
    length: Positive | None = None  # [m] at rest
    stiffness: NonNegative = 0.0  # [N/m]
    damping: NonNegative = 0.0  # [N s/m]
    law: Law | None = None  # [m], of t and parameters, instead of stiffness: its length while it stands
    attack: Law | None = None  # [rad] elevation of foot -> point while it swings, of t and parameters; default: it never lands
    heading: Law = 0.0  # [rad] azimuth of the foot from the point while it swings
    friction: Positive | Literal["rough"] = "rough"  # a force outside the cone: it lets go
    foot: tuple[float, float] | None = None  # [m] x and y: it stands at the start; default: it swings

    @property
    def reach(self) -> Law:
        """What its length [m] is while it swings: that at rest, or the law's."""
        return self.law if self.law is not None else self.length or 0.0


class UserEvent(Table, frozen=True, kw_only=True):
    """Something to be looked for along a run, by name."""

    name: Name
    when: str  # an equation: it happens where left - right goes through 0
    direction: Literal["down", "up", "both"] = "both"  # of left - right
    end: bool = False  # whether it ends the run


class Attach(Table, frozen=True, kw_only=True):
    """What a robot stands on, and how."""

    to: str = "ground"  # ground, ski, or a frame of another robot
    root: Literal["fixed", "free", "planar"] = "fixed"


class Robot(Table, frozen=True, kw_only=True):
    """A robot from a URDF."""

    name: Name
    urdf: str  # a path of example-robot-data, a file beside the scene or below, or the text of one
    attach: Attach = Attach()
    posture: str | dict[str, float] = ""  # a name in the robot's srdf, or values by joint, over the neutral one
    locked: tuple[str, ...] = ()  # joints that do not move
    aliases: dict[Name, str] = {}  # names for its frames
    points: dict[Name, tuple[str, float, float, float]] = {}  # points of its frames, as frames: which, and where [m] in it


class Weld(Table, frozen=True, kw_only=True):
    """Two frames that do not move against each other."""

    frames: tuple[str, str]
    pose: tuple[float, float, float, float, float, float] | None = None  # of the second in the first: x y z [m] roll pitch yaw


class Edge(Table, frozen=True, kw_only=True):
    """A knife edge: the frame's origin does not move along one axis."""

    frame: str
    axis: Literal["trace", "x", "y", "z"] = "trace"  # trace: z of the surface x the frame's x axis


class Posture(Table, frozen=True, kw_only=True):
    """What a robot's programme does with the joints that its rows leave free: it brings them back to the start posture."""

    frequency: Positive = 4.0  # [rad/s]
    damping_ratio: NonNegative = 1.0
    weights: dict[str, Positive] = {}  # of joints, default 1


class Programme(Table, frozen=True, kw_only=True):
    """Servo constraints and the controls that enforce them (paper, section 5)."""

    constraints: Annotated[tuple[str, ...], msgspec.Meta(min_length=1)]
    controls: Annotated[tuple[str, ...], msgspec.Meta(min_length=1)]
    frequency: Positive | tuple[Positive, ...] | None = None  # [rad/s]
    damping_ratio: NonNegative | tuple[NonNegative, ...] = 1.0
    gains: Literal["auto", "none"] | None = None  # none: H = K = 0, errors neither decay nor are checked
    h: tuple[tuple[Law, ...], ...] | None = None  # of (5.5), of the motion if it is text
    k: tuple[tuple[Law, ...], ...] | None = None
    weights: dict[str, Positive | str] = {}  # R_s > 0 of the norm sum R_s u_s^2; default 1/scale^2
    u0: Law | None = None  # the free scalar of (5.6)
    border: tuple[tuple[Law, ...], ...] = ()  # rows g^{kappa l} of (5.6), for u0 where controls are more than rows and one
    secondary: tuple[str, ...] = ()  # equations served in the null space, as far as it goes
    secondary_frequency: Positive | None = None  # [rad/s], default: frequency
    limits: Literal["report", "stop"] | None = None  # of a robot's joints, speeds and efforts; default report
    posture: Posture | None = None  # of a robot; default Posture()
    closed: tuple[str, ...] = ()  # contacts: it acts while all of these are closed
    open: tuple[str, ...] = ()  # and all of these open; default: always


class Smoothing(Table, frozen=True, kw_only=True):
    """How far a smoothing spline leaves the samples of measured data."""

    sigma: Positive  # rms of the samples less the curve, in the unit of the column


Smooth: TypeAlias = Literal["auto", "none"] | Smoothing


class Column(Table, frozen=True, kw_only=True):
    """A column of measured data."""

    source: str = msgspec.field(name="from", default="")  # its name in the file
    unit: str | None = None  # in which it is given; the scene has it in m, rad, N
    smooth: Smooth | None = None  # None: as the data
    values: tuple[float | None, ...] | None = None  # None for a sample that is missing


class Data(Table, frozen=True, kw_only=True):
    """Measured data: columns over time, which laws and rows may name as `mocap.knee`, `mocap.knee_dot`, `mocap.knee_ddot`."""

    name: Name
    columns: dict[Name, Column | str | tuple[float | None, ...]]
    file: str = ""  # beside the scene file, or below
    time: str | Column | tuple[float, ...] = "time"
    smooth: Smooth = "auto"
    gap: Positive = 0.2  # [s] longer holes are errors


class Run(Table, frozen=True, kw_only=True):
    """How to integrate; every key can be overridden by an argument of `simulate`."""

    duration: Positive = 5.0  # [s]
    method: Literal["euler", "rk4", "gauss", "dop853", "adams", "bdf", "radau"] = "dop853"
    rtol: Annotated[float, msgspec.Meta(ge=3e-14)] = 1e-8  # smaller ones are beyond double precision
    atol: Positive = 1e-10
    step: Positive | None = None  # [s], fixed-step methods
    samples: Positive = 60.0  # output samples per second when no t_eval is given
    knife_edge: Literal["reduction", "multiplier", "projection"] = "reduction"
    gain: NonNegative = 5.0  # [1/s], Baumgarte gain of ideal rows and of the knife edge as a multiplier
    fall: bool = True  # stop when a point of a link reaches the snow
    engine: Literal["auto", "core", "pinocchio"] = "auto"  # what evaluates the motion
    max_step: Positive | None = None  # [s], longest step of adaptive methods


class SceneTables(Table, frozen=True, kw_only=True):
    """All keys of a scene file, as the types alone check them."""

    name: str = "scene"
    gravity: NonNegative = 9.81  # [m/s^2]
    slope: Annotated[float, msgspec.Meta(gt=-1.5707, lt=1.5707)] = 0.0  # [rad]
    plane: bool = False
    base: Base
    links: tuple[Link, ...] = ()
    constraints: tuple[str, ...] = ()
    start: dict[str, float] = {}
    parameters: dict[Name, float] = {}
    forces: tuple[Force, ...] = ()
    data: tuple[Data, ...] = ()
    springs: tuple[Spring, ...] = ()
    robots: tuple[Robot, ...] = ()
    welds: tuple[Weld, ...] = ()
    edges: tuple[Edge, ...] = ()
    programme: Programme | None = None
    programmes: tuple[Programme, ...] = ()  # instead of `programme`: those that act at an instant are united
    contacts: tuple[Contact, ...] = ()
    legs: tuple[Leg, ...] = ()
    events: tuple[UserEvent, ...] = ()
    run: Run = Run()
    expect: dict[str, Any] = {}  # what the shipped models promise; read by the tests alone

    @property
    def touching(self) -> tuple[str, ...]:
        """Names of contacts, then of legs."""
        return (*(contact.name for contact in self.contacts), *(leg.name for leg in self.legs))

    @property
    def closing(self) -> tuple[str, ...]:
        """Names of all that opens and closes: those, and a ski that may leave the snow."""
        return (*self.touching, *(("ski",) if self.base.lift else ()))
