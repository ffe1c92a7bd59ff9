"""Letters and signs: what a renderer reads back is the font's own shape, and bad addresses say what there is."""

from __future__ import annotations

import gzip
import json
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pytest
import shapely
from hypothesis import assume, given
from hypothesis import strategies as st
from PIL import Image, ImageDraw, ImageFont

from app.map.style.signs import (
    BASELINE_PX,
    BORDER_PX,
    EM_PX,
    FILES,
    FONTS,
    SIDE_PX,
    distance_field,
    glyphs,
    sheet,
)
from problem_support import check

SANS = "/glyphs/DejaVu Sans/0-255.pbf"


def varint(data: bytes, at: int) -> tuple[int, int]:
    value = shift = 0
    while True:
        value |= (data[at] & 0x7F) << shift
        at, shift = at + 1, shift + 7
        if data[at - 1] < 0x80:
            return value, at


def fields(data: bytes) -> Iterator[tuple[int, Any]]:
    """(field number, value) of a protobuf message of integers and strings of bytes."""
    at = 0
    while at < len(data):
        key, at = varint(data, at)
        assert key & 7 in {0, 2}
        value, at = varint(data, at)
        if key & 7 == 2:
            yield key >> 3, data[at : at + value]
            at += value
        else:
            yield key >> 3, value


def read(message: bytes) -> tuple[str, str, dict[int, dict[str, Any]]]:
    """Name, range and letters of a message, as its readers declare them."""
    ((number, stack),) = fields(message)
    assert number == 1
    found = list(fields(stack))
    ((_, name), (_, span)) = found[:2]
    letters = {}
    for number, letter in found[2:]:
        assert number == 3
        parts = dict(fields(letter))
        left, top = ((value >> 1) ^ -(value & 1) for value in (parts[5], parts[6]))
        width, height = parts[3], parts[4]
        picture = np.frombuffer(parts.get(2, b""), np.uint8)
        if picture.size:
            picture = picture.reshape(height + 2 * BORDER_PX, width + 2 * BORDER_PX)
        letters[parts[1]] = {"left": left, "top": top, "advance": parts[7], "picture": picture}
    return name.decode(), span.decode(), letters


FINER = 8


def ink(font: str, character: str, letter: dict[str, Any]) -> Any:
    """How much of each pixel of a letter's picture FreeType covers, 0 to 1: drawn finely, then averaged."""
    file = Path(mpl.get_data_path()) / "fonts" / "ttf" / FONTS[font]
    big = ImageFont.truetype(file, EM_PX * FINER, layout_engine=ImageFont.Layout.BASIC)
    height, width = letter["picture"].shape
    page = Image.new("L", (width * FINER, height * FINER))
    left, baseline = BORDER_PX - letter["left"], BORDER_PX + letter["top"] + BASELINE_PX
    ImageDraw.Draw(page).text((left * FINER, baseline * FINER), character, 255, font=big, anchor="ls")
    return np.asarray(page, float).reshape(height, FINER, width, FINER).mean(axis=(1, 3)) / 255


@pytest.mark.parametrize("font", FONTS)
def test_letters_have_the_shape_that_freetype_draws(font: str) -> None:
    name, span, letters = read(glyphs((font,), 0))
    assert (name, span) == (font, "0-255")
    assert not letters[ord(" ")]["picture"].size
    for character in "0148%±AgQßé":
        letter = letters[ord(character)]
        inside = np.clip((letter["picture"].astype(float) - 191) / 32 + 0.5, 0, 1)
        beside = ink(font, character, letter)
        assert beside.sum() > 10
        assert np.abs(inside - beside).mean() < 0.02, character
        assert np.abs(inside - beside).max() < 0.5, character
        assert abs(inside.sum() - beside.sum()) < 0.05 * beside.sum(), character


def test_figures_stand_in_the_middle_of_what_they_label() -> None:
    """A renderer puts the picture's top 17 px above the place that it labels."""
    _, _, letters = read(glyphs(("DejaVu Sans",), 0))
    for character in "05%":
        letter = letters[ord(character)]
        height = letter["picture"].shape[0] - 2 * BORDER_PX
        assert abs(-17 - letter["top"] + height / 2) <= 1.5


@given(
    corners=st.lists(
        st.tuples(st.floats(-8, 8, width=32), st.floats(-8, 8, width=32)), min_size=3, max_size=6, unique=True
    ),
    radius=st.sampled_from([4.0, 8.0, 16.0]),
)
def test_pixels_tell_their_distance(corners: list[tuple[float, float]], radius: float) -> None:
    """Against shapely, for outlines that do not cross themselves."""
    shape = shapely.Polygon(corners)
    assume(shape.is_valid and shape.area > 0.1)
    field = distance_field([np.array(corners, float)], -12, 12, 24, 24, radius=radius)
    x, y = np.meshgrid(np.arange(24) - 11.5, 11.5 - np.arange(24))
    points = shapely.points(x, y)
    away = shapely.distance(shape.exterior, points)
    signed = np.where(shapely.contains(shape, points), -away, away)
    expected = np.clip(255 - 256 * (signed / radius + 0.25), 0, 255)
    assert np.abs(field - expected)[away > 1e-6].max() <= 0.51


def test_a_range_without_letters_is_a_message_without_letters() -> None:
    assert read(glyphs(("DejaVu Sans",), 0x10FF00)) == ("DejaVu Sans", "1113856-1114111", {})


def test_the_first_font_that_has_a_letter_draws_it() -> None:
    _, _, both = read(glyphs(("DejaVu Sans Bold", "DejaVu Sans"), 0))
    _, _, bold = read(glyphs(("DejaVu Sans Bold",), 0))
    _, _, usual = read(glyphs(("DejaVu Sans",), 0))
    assert np.array_equal(both[ord("A")]["picture"], bold[ord("A")]["picture"])
    assert not np.array_equal(usual[ord("A")]["picture"], bold[ord("A")]["picture"])


def test_letters_that_every_map_asks_for_are_light() -> None:
    assert len(gzip.compress(glyphs(("DejaVu Sans",), 0), 6, mtime=0)) < 34_000


def test_letters_are_served_and_kept(reading: Any) -> None:
    answer = reading.client.get(SANS)
    assert answer.status_code == 200
    assert answer.headers["content-type"] == "application/x-protobuf"
    assert answer.content == glyphs(("DejaVu Sans",), 0)
    assert "max-age" in answer.headers["cache-control"]
    again = reading.client.get(SANS, headers={"If-None-Match": answer.headers["etag"]})
    assert (again.status_code, again.content) == (304, b"")
    mixed = reading.client.get("/glyphs/Open Sans Regular,DejaVu Sans/0-255.pbf")
    assert mixed.content == answer.content


@pytest.mark.parametrize("font", ["Arial", "", "DejaVu", "dejavu sans", "../DejaVuSans", "a" * 3000])
def test_an_unknown_font_names_those_that_there_are(reading: Any, font: str) -> None:
    answer = reading.client.get(f"/glyphs/{font}/0-255.pbf")
    problem = check(answer, 404)
    if font and "/" not in font:
        assert all(name in problem["detail"] for name in FONTS)


@pytest.mark.parametrize(
    "span",
    ["0-254", "1-256", "256-255", "-256--1", "0-255-0", "a-b", "0", "1114112-1114367", "9" * 50, "٠-٢٥٥"],
)
def test_a_malformed_range_says_what_ranges_are(reading: Any, span: str) -> None:
    assert "0-255" in check(reading.client.get(f"/glyphs/DejaVu Sans/{span}.pbf"), 404)["detail"]


def test_signs_lie_in_the_picture_where_the_list_says() -> None:
    for ratio in (1, 2):
        suffix = "@2x" if ratio == 2 else ""
        listed = json.loads(sheet(f"versant{suffix}.json")[0])
        with Image.open(BytesIO(sheet(f"versant{suffix}.png")[0])) as picture:
            assert picture.mode == "RGBA"
            opacity = np.asarray(picture)[..., 3].astype(float)
        assert listed.keys() == {"uphill"}
        for sign in listed.values():
            assert sign["pixelRatio"] == ratio
            assert sign["sdf"] is True
            assert (sign["width"], sign["height"]) == (ratio * SIDE_PX, ratio * SIDE_PX)
            part = opacity[sign["y"] : sign["y"] + sign["height"], sign["x"] : sign["x"] + sign["width"]]
            assert part.shape == (sign["height"], sign["width"])
            inside = part >= 191
            assert inside.any()
            assert part[[0, -1]].max() < 191, "a halo has room"
            # An arrow that points to the right: its right end is narrow, and it is alike above and below.
            columns = inside.sum(axis=0)
            ends = np.flatnonzero(columns)
            assert columns[ends[-1]] < columns[ends[0] + 2 * ratio]
            assert np.array_equal(part, part[::-1])


@pytest.mark.parametrize("file", FILES)
def test_signs_are_served_and_kept(reading: Any, file: str) -> None:
    answer = reading.client.get(f"/sprites/{file}")
    assert answer.content == sheet(file)[0]
    assert answer.headers["content-type"] == ("image/png" if file.endswith("png") else "application/json")
    again = reading.client.get(f"/sprites/{file}", headers={"If-None-Match": answer.headers["etag"]})
    assert again.status_code == 304
    assert again.headers["etag"] == answer.headers["etag"]


@pytest.mark.parametrize("file", ["versant", "versant@3x.png", "other.json", "versant.svg"])
def test_an_unknown_sheet_names_those_that_there_are(reading: Any, file: str) -> None:
    assert "versant@2x.png" in check(reading.client.get(f"/sprites/{file}"), 404)["detail"]
