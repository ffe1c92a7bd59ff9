"""Text on pictures: what the font can write, how wide it gets, and lines that fit a width.

Importing this imports matplotlib: import it where a picture is drawn.
"""

from __future__ import annotations

from functools import cache

from matplotlib.font_manager import FontProperties, findfont, get_font
from matplotlib.textpath import text_to_path

MISSING = "?"
"""Stands for what the font has no glyph of."""


@cache
def _glyphs() -> frozenset[int]:
    return frozenset(get_font(findfont(FontProperties())).get_charmap())


def is_writable(text: str) -> bool:
    """Whether the font has a glyph for every character."""
    return all(character.isprintable() and ord(character) in _glyphs() for character in text)


def writable(text: str) -> str:
    """Anyone's text on one line, with ``MISSING`` for what the font cannot write; control characters are spaces."""
    printable = "".join(c if c.isprintable() else " " for c in text)
    return "".join(c if is_writable(c) else MISSING for c in " ".join(printable.split()))


def width_pt(text: str, size_pt: float) -> float:
    """How wide a line is, points, in the font that pictures are written in."""
    width, _, _ = text_to_path.get_text_width_height_descent(text, FontProperties(size=size_pt), ismath=False)
    return float(width)


def wrapped(text: str, size_pt: float, room_pt: float) -> list[str]:
    """The text, made ``writable``, as lines that fit; a word longer than a line is broken."""
    lines = [""]
    for word in writable(text).split(" "):
        rest = word
        longer = f"{lines[-1]} {word}" if lines[-1] else word
        if width_pt(longer, size_pt) <= room_pt:
            lines[-1] = longer
            continue
        while rest:
            fits = _fitting(rest, size_pt, room_pt)
            lines.append(rest[:fits])
            rest = rest[fits:]
    return [line for line in lines if line] or [""]


def _fitting(word: str, size_pt: float, room_pt: float) -> int:
    """How many characters of a word fit, at least one."""
    low, high = 1, len(word)
    while low < high:
        middle = (low + high + 1) // 2
        low, high = (middle, high) if width_pt(word[:middle], size_pt) <= room_pt else (low, middle - 1)
    return low
