"""The paper's symbols of coordinates, rates and forces, with their units, for labels of figures."""

from __future__ import annotations

from collections.abc import Sequence

from vlmb.model.coordinates import Coordinate


def plain(text: str) -> str:
    """Keep a name from being read as mathematics."""
    return text.replace("$", r"\$")


def counted(number: int, noun: str) -> str:
    """Return the number with its noun, in the plural unless it is 1."""
    return f"{number} {noun}{'' if number == 1 else 's'}"


def short(text: str, most: int = 44) -> str:
    """Cut a long equation for a legend, and keep it from being read as mathematics."""
    return plain(text if len(text) <= most else f"{text[: most - 3]}...")


def symbol(coordinate: Coordinate, dot: bool = False) -> str:
    r"""Return the paper's symbol of a coordinate or its rate: \varphi_1, \psi_1, \xi_{11}, \dot{x}."""
    number = coordinate.link + 1
    letter = {"phi": r"\varphi", "phi0": r"\varphi", "psi": r"\psi", "xi": r"\xi"}.get(coordinate.kind, coordinate.kind)
    index = {"phi": f"{number}", "phi0": "0", "psi": f"{number}"}.get(coordinate.kind, "")
    if coordinate.kind == "xi":
        index = f"{number}{coordinate.segment}" if number < 10 else f"{number},{coordinate.segment}"
    letter = rf"\dot{{{letter}}}" if dot else letter
    return f"${letter}_{{{index}}}$" if index else f"${letter}$"


def unit(coordinate: Coordinate, dot: bool = False) -> str:
    """Return the unit of a coordinate or its rate."""
    return ("rad" if coordinate.kind in ("phi", "phi0", "psi") else "m") + ("/s" if dot else "")


def group_symbol(group: Sequence[Coordinate], dot: bool) -> str:
    """Name a panel: the symbols themselves when they are few, else one with the index i."""
    if len(group) <= 3:
        return ", ".join(symbol(c, dot) for c in group)
    letter = {"psi": r"\psi", "xi": r"\xi"}.get(group[-1].kind, r"\varphi")
    index = f"i{group[-1].segment}" if group[-1].kind == "xi" else "i"
    return rf"$\dot{{{letter}}}_{{{index}}}$" if dot else f"${letter}_{{{index}}}$"


def force_symbol(name: str) -> str:
    r"""Return the symbol of a control: M_{\varphi_1}, F_{11}, T_{legs}; a prescribed segment's force is F along its xi."""
    greek = {"phi": r"\varphi", "psi": r"\psi"}
    letter, _, index = name.partition("_")
    if letter == "M" and index[:3] in greek and index[3:].isdigit():
        return f"$M_{{{greek[index[:3]]}_{{{index[3:]}}}}}$"
    if letter[:1] == "F" and letter[1:].isdigit() and index.isdigit():
        return f"$F_{{{letter[1:]}{',' if int(letter[1:]) > 9 else ''}{index}}}$"
    return f"$T$ {index}" if letter == "T" else name
