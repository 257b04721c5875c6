"""Where a long chain can be cut into pieces, and the scene of each piece."""

from __future__ import annotations

import msgspec

from vlmb.scene import BASE, Base, Scene

PIECE = 8  # links in a piece (benchmarks/results/long_chains.md)
LONG_CHAIN = 24  # longer chains are cut, where they can be: less time, memory and error (benchmarks/results/long_chains.md)
LONGEST = 40  # links in a piece where no hinge before it can be cut


def is_cut(scene: Scene) -> bool:
    """Whether a scene is a chain so long that it runs as sub-chains, if nothing else keeps it from that."""
    return len(scene.links) > LONG_CHAIN and obstacle(scene) is None


def obstacle(scene: Scene) -> str | None:
    """Say what keeps a scene from being cut into sub-chains; None where nothing does."""
    chained = all(
        link.parent == before and (link.parent_point == "tip" or before == BASE)
        for link, before in zip(scene.links, [BASE, *(link.name for link in scene.links)], strict=False)
    )
    moved = [link.name for link in scene.links if "prescribed" in (link.lower.motion, link.upper.motion)]
    for found, why in (
        (not chained, "links that branch or hang on a rod"),
        (bool(scene.constraints), "`constraints`"),
        (scene.programme is not None, "a `programme`"),
        (bool(scene.forces), "`forces`"),
        (bool(moved), f"prescribed segments ({', '.join(moved[:3])})"),
        (scene.plane and scene.base.kind == "ski", "plane = true on a ski"),
    ):
        if found:
            return why
    longest = max((last - first for first, last in cuts(scene, PIECE)), default=0)
    if longest > LONGEST:
        return f"{longest} links in a row without a hinge to cut at (one with tip_mass > 0, or between two fixed segments)"
    return None


def cuts(scene: Scene, size: int) -> list[tuple[int, int]]:
    """Return (first, last + 1) of each piece: `size` links, or more up to the next hinge where both sides keep inertia."""
    found, first, links = [], 0, scene.links
    for last in range(1, len(links) + 1):
        sound = last < len(links) and (
            links[last - 1].tip_mass > 0.0 or links[last - 1].upper.motion == links[last].lower.motion == "fixed"
        )
        if last == len(links) or (sound and last - first >= size):
            found.append((first, last))
            first = last
    return found


def part(scene: Scene, first: int, last: int) -> Scene:
    """Make the scene of one piece; a mass in a cut hinge is halved between its two sides."""
    links = list(scene.links[first:last])
    links[0] = msgspec.structs.replace(links[0], parent=BASE)
    if last < len(scene.links):
        links[-1] = msgspec.structs.replace(links[-1], tip_mass=0.5 * links[-1].tip_mass)
    base, gravity = scene.base, scene.gravity
    if first:
        base, gravity = Base(kind="free", mass=0.5 * scene.links[first - 1].tip_mass), 0.0
    return Scene(base=base, links=tuple(links), gravity=gravity, slope=scene.slope, plane=scene.plane)
