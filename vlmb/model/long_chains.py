"""Long chains: which scenes run as sub-chains, every link a piece of its own."""

from __future__ import annotations

from vlmb.scene.scene import Scene
from vlmb.scene.tables import BASE

LONG_CHAIN = 24  # links; longer chains run as sub-chains if they can: aba loses digits (benchmarks/results/evaluation.md)


def is_long(scene: Scene) -> bool:
    """Whether a scene is a chain so long that it runs as sub-chains, if nothing else keeps it from that."""
    return len(scene.links) > LONG_CHAIN and obstacle(scene) is None


def obstacle(scene: Scene) -> str | None:
    """Say what keeps a scene from running as sub-chains; None where nothing does."""
    chained = all(
        link.parent == before and (link.parent_point == "tip" or before == BASE)
        for link, before in zip(scene.links, [BASE, *(link.name for link in scene.links)], strict=False)
    )
    anchored = [link.name for link in scene.links if any(link.anchor or ())]
    flat = [
        link.name
        for link in scene.links[:-1]
        if link.lower.motion == link.upper.motion == "fixed"
        and not (link.lower.length or 0.0) + link.rod.length + (link.upper.length or 0.0)
    ]
    moved = [link.name for link in scene.links if "prescribed" in (link.lower.motion, link.upper.motion)]
    for found, why in (
        (not chained, "links that branch or hang on a rod"),
        (bool(anchored), f"a link on an anchor ({', '.join(anchored[:3])})"),
        (bool(scene.constraints), "`constraints`"),
        (scene.programme is not None, "a `programme`"),
        (bool(scene.forces), "`forces`"),
        (bool(moved), f"prescribed segments ({', '.join(moved[:3])})"),
        (bool(flat), f"links whose ends coincide ({', '.join(flat[:3])})"),
        (scene.plane and scene.base.kind == "ski", "plane = true on a ski"),
    ):
        if found:
            return why
    return None
