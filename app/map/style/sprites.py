"""Signs of the map as one picture and the list of what is where in it, for screens of usual and of double resolution.

Signs are signed distance fields in the picture's opacity: a style chooses their colour, halo and size.
"""

from __future__ import annotations

import json
from functools import lru_cache
from io import BytesIO

import numpy as np
from PIL import Image

from app.core.errors import NotFoundError
from app.map.style.outlines import distance_field
from fusion.types import Floats

SHEET = "versant"
UPHILL = "uphill"
RATIOS = {"": 1, "@2x": 2}
_SIGNS: dict[str, Floats] = {
    # Points to the right: a style turns it along the line, or against it.
    UPHILL: np.array([(-6.5, -6.0), (7.5, 0.0), (-6.5, 6.0), (-3.0, 0.0)]),
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
        raise NotFoundError(f"There is no {file[:100]!r}. There are: {', '.join(FILES)}.", field="file")
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
