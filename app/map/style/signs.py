"""Signs and letters of the map, as maps in a browser read them: signed distance fields, sharp at every size and turn.

Each pixel says how far its middle is from the outline. The distances are exact, to the outline's own lines, instead of
being taken from a picture of it. Signs stand in the opacity of one picture, with a list of what is where in it; letters
come by 256 characters in one protobuf message. The font is DejaVu, which matplotlib brings along, under a free licence
of its own (Bitstream Vera, and public domain). Nothing of it is copied: its outlines are read where they are installed.
"""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from functools import cache, lru_cache
from importlib.util import find_spec
from io import BytesIO
from pathlib import Path
from threading import Lock
from typing import Any

import numpy as np
from fontTools.pens.basePen import BasePen
from fontTools.ttLib import TTFont
from numpy.typing import NDArray
from PIL import Image

from app.core.errors import NotFoundError
from app.core.messages import say
from app.core.text import varint
from fusion.types import Floats

CUTOFF = 0.25
"""Of the range of a pixel's values, what lies inside of an outline: 191 is on it, as renderers of maps expect."""
ON_OUTLINE = 191
_ROWS_AT_ONCE = 512


def distance_field(
    contours: Sequence[Floats], left: int, top: int, width: int, height: int, *, radius: float = 8.0
) -> NDArray[np.uint8]:
    """A picture of ``height`` rows of ``width`` pixels, whose upper left corner is at (left, top).

    ``contours`` are closed lines (n, 2), x to the right and y upwards, in pixels; what they wind around is inside
    (nonzero rule). A pixel on the outline is 191, one that is ``radius`` farther outside is 64 levels a quarter of the
    radius less, and none is below 0 or above 255.
    """
    x = left + 0.5 + np.arange(width)
    y = top - 0.5 - np.arange(height)
    points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    starts = np.concatenate(list(contours))
    ends = np.concatenate([np.roll(line, -1, axis=0) for line in contours])
    pieces = [
        _signed_distance(points[k : k + _ROWS_AT_ONCE], starts, ends)
        for k in range(0, len(points), _ROWS_AT_ONCE)
    ]
    outside = np.concatenate(pieces) / radius + CUTOFF
    return np.clip(np.rint(255 - 256 * outside), 0, 255).astype(np.uint8).reshape(height, width)


def _signed_distance(points: Floats, starts: Floats, ends: Floats) -> Floats:
    """Distance of points (m, 2) from lines (n, 2) to (n, 2): positive outside."""
    along = ends - starts
    length2 = np.maximum((along**2).sum(axis=1), 1e-18)
    to = points[:, None, :] - starts[None, :, :]
    share = np.clip((to * along).sum(axis=2) / length2, 0.0, 1.0)
    away = to - share[:, :, None] * along
    nearest = np.sqrt((away**2).sum(axis=2).min(axis=1))
    # How often the outline winds around a point: lines that a ray to the right crosses upwards, less downwards.
    y = points[:, 1, None]
    turn = along[:, 0] * to[:, :, 1] - along[:, 1] * to[:, :, 0]
    upwards = (starts[:, 1] <= y) & (ends[:, 1] > y) & (turn > 0)
    downwards = (starts[:, 1] > y) & (ends[:, 1] <= y) & (turn < 0)
    winding = upwards.sum(axis=1) - downwards.sum(axis=1)
    return np.asarray(np.where(winding != 0, -nearest, nearest), float)


SHEET = "versant"
UPHILL = "uphill"
RATIOS = {"": 1, "@2x": 2}
_SIGNS: dict[str, Floats] = {
    # Points to the right: a style turns it along the line, or against it.
    UPHILL: np.array([(-6.5, -6.0), (7.5, 0.0), (-6.5, 6.0), (-3.0, 0.0)])
}
"""Outlines around the origin, y upwards, in pixels of a usual screen."""
SIDE_PX = 20
"""Of the box that each sign has for itself: with room for a halo, and no more, since labels keep out of it."""
RADIUS_PX = 8.0
FILES = tuple(f"{SHEET}{ratio}.{kind}" for ratio in RATIOS for kind in ("json", "png"))


@lru_cache
def sheet(file: str) -> tuple[bytes, str]:
    """Content and media type of one of ``FILES``; ``NotFoundError`` that lists them for any other."""
    if file not in FILES:
        raise NotFoundError(say("style.no_file", name=file[:100], names=", ".join(FILES)), field="file")
    stem, kind = file.rsplit(".", 1)
    ratio = RATIOS[stem.removeprefix(SHEET)]
    return (_index(ratio), "application/json") if kind == "json" else (_picture(ratio), "image/png")


def _index(ratio: int) -> bytes:
    side = SIDE_PX * ratio
    places = {
        name: {"x": k * side, "y": 0, "width": side, "height": side, "pixelRatio": ratio, "sdf": True}
        for k, name in enumerate(_SIGNS)
    }
    return json.dumps(places).encode()


def _picture(ratio: int) -> bytes:
    side, half = SIDE_PX * ratio, SIDE_PX * ratio // 2
    fields = [
        distance_field([outline * ratio], -half, half, side, side, radius=RADIUS_PX * ratio)
        for outline in _SIGNS.values()
    ]
    opacity = np.concatenate(fields, axis=1)
    pixels = np.zeros((*opacity.shape, 4), np.uint8)
    pixels[..., 3] = opacity
    out = BytesIO()
    Image.fromarray(pixels).save(out, "PNG", optimize=True)
    return out.getvalue()


FONTS = {
    "DejaVu Sans": "DejaVuSans.ttf",
    "DejaVu Sans Bold": "DejaVuSans-Bold.ttf",
    "DejaVu Sans Oblique": "DejaVuSans-Oblique.ttf",
}
"""Names that a style may ask for, and their files."""
FONT_CREDIT = "DejaVu fonts: Bitstream Vera and DejaVu changes, free licence"

EM_PX = 24
BORDER_PX = 3
"""Around each letter, for halos; sizes in the message leave it out."""
BASELINE_PX = 26
"""From the line that a renderer puts a letter's top against down to the baseline: renderers centre text as if it were
17 px above, so that figures, which are 18 px high, stand in the middle of what they label."""
_LEVELS = 4
"""Steps of letters' pixels, an eighth of a pixel at 24 px to the em: nobody sees them, and a message packs to two
thirds, which a map waits for before it shows its first name."""
PER_RANGE = 256
MOST_CHARACTER = 0x10FFFF
MOST_KEPT = 500
"""Messages: of three fonts all that are not empty are some two hundred, one after the other."""
_STEPS = 4
"""Straight lines that a curve of an outline becomes, at 24 px to the em: nowhere off by more than 0.05 px."""
_RANGE = re.compile(r"(\d{1,7})-(\d{1,7})", re.ASCII)


def fonts_of(stack: str) -> tuple[str, ...]:
    """Those of the fonts, separated by commas, that there are; the first that has a letter draws it.

    Raises ``NotFoundError`` that lists the fonts where there is none of them.
    """
    known = tuple(dict.fromkeys(name for part in stack.split(",") if (name := part.strip()) in FONTS))
    if not known:
        raise NotFoundError(say("style.no_font", name=stack[:100], names=", ".join(FONTS)), field="fontstack")
    return known


def first_of_range(text: str) -> int:
    """The first character of a range such as 0-255; ``NotFoundError`` for anything else."""
    match = _RANGE.fullmatch(text)
    if match is not None:
        first, last = int(match[1]), int(match[2])
        if first % PER_RANGE == 0 and last == first + PER_RANGE - 1 and last <= MOST_CHARACTER:
            return first
    raise NotFoundError(
        say("style.no_range", text=text[:40], n=PER_RANGE),
        field="range",
    )


_drawing = Lock()


@lru_cache(maxsize=MOST_KEPT)
def glyphs(fonts: tuple[str, ...], first: int) -> bytes:
    """The message of characters ``first`` to ``first`` + 255; those that no font has are not in it."""
    drawn = []
    with _drawing:  # who asks for the same meanwhile gets the letters that the first one drew
        for character in range(first, first + PER_RANGE):
            font = next((FONTS[name] for name in fonts if character in _font(FONTS[name]).names), None)
            if font is not None:
                drawn.append(_tagged(3, _glyph(font, character)))
    name = _tagged(1, ",".join(fonts).encode())
    span = _tagged(2, f"{first}-{first + PER_RANGE - 1}".encode())
    return _tagged(1, b"".join((name, span, *drawn)))


class _Font:
    """One file's outlines, in pixels at ``EM_PX`` to the em."""

    def __init__(self, path: Path) -> None:
        font = TTFont(path, lazy=True)
        self.names: dict[int, str] = font.getBestCmap()
        self.outlines = font.getGlyphSet()
        self.scale = EM_PX / font["head"].unitsPerEm


@cache
def _glyph(file: str, character: int) -> bytes:
    """The message of one letter that a font has; one without ink, such as a space, has no picture."""
    font = _font(file)
    name = font.names[character]
    pen = _Lines(font.outlines, font.scale)
    font.outlines[name].draw(pen)
    advance = max(round(font.outlines[name].width * font.scale), 0)
    if not pen.contours:
        return _letter(character, b"", 0, 0, 0, 0, advance)
    contours = [np.array(line) for line in pen.contours]
    least, most = np.vstack(contours).min(axis=0), np.vstack(contours).max(axis=0)
    left, bottom = (int(v) for v in np.floor(least))
    right, top = (int(v) for v in np.ceil(most))
    width, height = right - left, top - bottom
    picture = distance_field(
        contours, left - BORDER_PX, top + BORDER_PX, width + 2 * BORDER_PX, height + 2 * BORDER_PX
    )
    coarse = ON_OUTLINE + _LEVELS * np.rint((picture.astype(int) - ON_OUTLINE) / _LEVELS)
    picture = np.clip(coarse, 0, 255).astype(np.uint8)
    return _letter(character, picture.tobytes(), width, height, left, top - BASELINE_PX, advance)


@cache
def _font(file: str) -> _Font:
    package = find_spec("matplotlib")  # where it is, without loading it
    assert package is not None  # noqa: S101 - the package depends on it
    assert package.origin is not None  # noqa: S101
    return _Font(Path(package.origin).parent / "mpl-data" / "fonts" / "ttf" / file)


class _Lines(BasePen):  # type: ignore[misc]
    """Takes an outline as closed lines of pixels."""

    def __init__(self, outlines: Any, scale: float) -> None:
        super().__init__(outlines)
        self.contours: list[list[tuple[float, float]]] = []
        self._scale = scale

    def _moveTo(self, pt: tuple[float, float]) -> None:  # noqa: N802 - the pen's protocol
        self.contours.append([self._pixel(pt)])

    def _lineTo(self, pt: tuple[float, float]) -> None:  # noqa: N802
        self.contours[-1].append(self._pixel(pt))

    def _qCurveToOne(self, pt1: tuple[float, float], pt2: tuple[float, float]) -> None:  # noqa: N802
        start, handle, end = self.contours[-1][-1], self._pixel(pt1), self._pixel(pt2)
        for t in np.arange(1, _STEPS + 1) / _STEPS:
            a, b, c = (1 - t) ** 2, 2 * t * (1 - t), t**2
            self.contours[-1].append(
                (a * start[0] + b * handle[0] + c * end[0], a * start[1] + b * handle[1] + c * end[1])
            )

    def _closePath(self) -> None:  # noqa: N802
        pass

    def _pixel(self, point: tuple[float, float]) -> tuple[float, float]:
        return point[0] * self._scale, point[1] * self._scale


def _letter(
    character: int, picture: bytes, width: int, height: int, left: int, top: int, advance: int
) -> bytes:
    numbers = ((3, width), (4, height), (5, _zigzag(left)), (6, _zigzag(top)), (7, advance))
    parts = [_key(1, 0), varint(character), *([_tagged(2, picture)] if picture else [])]
    for field, value in numbers:
        parts += [_key(field, 0), varint(value)]
    return b"".join(parts)


def _tagged(field: int, content: bytes) -> bytes:
    return b"".join((_key(field, 2), varint(len(content)), content))


def _key(field: int, kind: int) -> bytes:
    return varint(field << 3 | kind)


def _zigzag(value: int) -> int:
    return value << 1 if value >= 0 else (-value << 1) - 1
