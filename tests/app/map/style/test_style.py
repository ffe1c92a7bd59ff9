"""The map's style: it names only what the service has, and its expressions draw what the pictures draw."""

from __future__ import annotations

import json
import shutil
import subprocess
from bisect import bisect_right
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib import colormaps
from matplotlib.colors import to_hex

from app.map.picture.slope_map import certain_signs, line_widths
from app.map.style.layers import LAYER, ZOOMS
from app.map.style.names import NAMES
from app.map.style.routes import THEMES, first_view, style_document
from app.map.style.scale import (
    COLOUR_NAMES,
    COLOURS_ON_DARK,
    SIGMA_COLOURS,
    SIGMA_COLOURS_ON_DARK,
    scale_of,
)
from app.map.style.signs import FONTS, sheet
from app.map.tiles.names import LAYERS as NAME_LAYERS
from problem_support import check
from style_expressions import Feature, evaluate

BASE = "http://127.0.0.1:8000"
HIGHWAYS = (
    "motorway",
    "trunk_link",
    "primary",
    "secondary",
    "tertiary",
    "residential",
    "service",
    "track",
    "x",
)
EVERY = [(theme, colour) for theme in THEMES for colour in COLOUR_NAMES]
features = st.fixed_dictionaries(
    {"highway": st.sampled_from(HIGHWAYS), "drives": st.just(1), "oneway": st.sampled_from([-1, 0, 1])},
    optional={
        "slope_percent": st.floats(-40, 40),
        "slope_sigma_percent": st.floats(0.01, 10),
        "dem_slope_percent": st.floats(-40, 40),
        "bridge": st.just(True),
        "tunnel": st.just(True),
    },
)


def words(thing: Any, head: str) -> Iterator[str]:
    """First arguments of all expressions of a kind anywhere in the style."""
    if isinstance(thing, dict):
        for value in thing.values():
            yield from words(value, head)
    elif isinstance(thing, list):
        if len(thing) == 2 and thing[0] == head and isinstance(thing[1], str):
            yield thing[1]
        for value in thing:
            yield from words(value, head)


def layers_of(theme: str, colour: str, part: str = "") -> list[dict[str, Any]]:
    return [one for one in style_document(BASE, theme, colour)["layers"] if one["id"].startswith(part)]


def drawn(theme: str, colour: str, part: str, feature: Feature, zoom: float = 16) -> dict[str, Any] | None:
    """The one layer of a part that shows the feature, or None."""
    found = [
        one
        for one in layers_of(theme, colour, part)
        if one.get("minzoom", 0) <= zoom and evaluate(one["filter"], feature, zoom)
    ]
    assert len(found) <= 1
    return found[0] if found else None


@pytest.mark.parametrize(("theme", "colour"), EVERY)
def test_the_style_names_only_what_the_service_has(theme: str, colour: str) -> None:
    style = style_document(BASE, theme, colour)
    assert style["version"] == 8
    assert json.loads(json.dumps(style, allow_nan=False)) == style
    ids = [layer["id"] for layer in style["layers"]]
    assert len(set(ids)) == len(ids)
    assert style["layers"][0]["type"] == "background"
    assert set(style["sources"]) == {"slopes", NAMES}
    for layer in style["layers"][1:]:
        drawn = {"slopes": {LAYER}, NAMES: set(NAME_LAYERS)}[layer["source"]]
        assert layer["source-layer"] in drawn
        assert 0 <= layer.get("minzoom", 0) <= 18
        assert set(layer.get("layout", {}).get("text-font", [])) <= set(FONTS)
        image = layer.get("layout", {}).get("icon-image")
        assert image is None or image in json.loads(sheet("versant.json")[0])
    for address in (style["sprite"], style["glyphs"], *(one["url"] for one in style["sources"].values())):
        assert address.startswith(f"{BASE}/")
    assert style["glyphs"].endswith("/{fontstack}/{range}.pbf")
    legend = style["metadata"]["versant:legend"]["classes"]
    assert [one["to_percent"] for one in legend[:-1]] == [one["from_percent"] for one in legend[1:]]
    assert [entry["colour"] for entry in legend] == list(scale_of(colour, dark=theme == "dark").colours)


def coloured(colour: str, feature: Feature) -> float | None:
    """The figure that a colour stands for."""
    slope, modelled = feature.get("slope_percent"), feature.get("dem_slope_percent")
    if colour == "elevation-model":
        return None if modelled is None else abs(modelled)
    if slope is None:
        return None
    if colour == "difference":
        return None if modelled is None else abs(slope - modelled)
    return abs(slope) if colour == "steepness" else float(feature.get("slope_sigma_percent", 3.0))


@pytest.mark.parametrize(("theme", "colour"), EVERY)
@given(feature=features, zoom=st.floats(13, 19))
def test_every_road_is_drawn_once_and_in_the_colour_of_its_class(
    theme: str, colour: str, feature: Feature, zoom: float
) -> None:
    value = coloured(colour, feature)
    known = value is not None
    slope, unknown = (drawn(theme, colour, part, feature, zoom) for part in ("slope", "unknown"))
    assert (slope is not None, unknown is not None) == (known, not known)
    shown = slope or unknown
    assert shown is not None
    assert evaluate(shown["paint"]["line-width"], feature, zoom) >= 0.69
    if slope is None:
        assert shown["paint"]["line-color"] == THEMES[theme].unknown
        return
    assert value is not None
    scale = scale_of(colour, dark=theme == "dark")
    expected = scale.colours[bisect_right(scale.breaks_percent, value) - 1]
    assert evaluate(slope["paint"]["line-color"], feature, zoom) == expected


@given(sigma=st.floats(0.01, 20), zoom=st.sampled_from(ZOOMS), highway=st.sampled_from(HIGHWAYS))
def test_lines_narrow_with_doubt_as_in_pictures(sigma: float, zoom: int, highway: str) -> None:
    def width(sigma: float) -> float:
        feature = {"highway": highway, "slope_percent": 3.0, "slope_sigma_percent": sigma}
        layer = drawn("light", "steepness", "slope", feature, zoom)
        assert layer is not None
        return float(evaluate(layer["paint"]["line-width"], feature, zoom))

    share = float(line_widths(np.array([sigma]))[0] / line_widths(np.array([0.01]))[0])
    assert width(sigma) == pytest.approx(max(share * width(0.01), 0.7), rel=1e-6)


@given(highway=st.sampled_from(HIGHWAYS), slope=st.none() | st.floats(-9, 9), zoom=st.sampled_from(ZOOMS[3:]))
def test_bridges_have_rims_and_tunnels_are_dashed(highway: str, slope: float | None, zoom: int) -> None:
    feature = {"highway": highway, "bridge": True} | ({} if slope is None else {"slope_percent": slope})
    road = drawn("light", "steepness", "unknown" if slope is None else "slope", feature, zoom)
    rim = drawn("light", "steepness", "bridge", feature, zoom)
    assert road is not None
    assert rim is not None
    widths = [evaluate(one["paint"]["line-width"], feature, zoom) for one in (road, rim)]
    assert widths[1] == pytest.approx(widths[0] + 3)
    assert drawn("light", "steepness", "tunnel", feature, zoom) is None
    dashes = drawn("light", "steepness", "tunnel", {"highway": highway, "tunnel": True}, zoom)
    assert dashes is not None
    assert evaluate(dashes["paint"]["line-width"], feature, zoom) > widths[0]


def test_arrows_of_the_elevation_model_are_its_own() -> None:
    feature = {"highway": "primary", "slope_percent": -5.0, "dem_slope_percent": 5.0}
    arrow = drawn("light", "elevation-model", "uphill", feature)
    assert arrow is not None
    assert evaluate(arrow["layout"]["icon-rotate"], feature) == 0
    assert drawn("light", "difference", "uphill", feature) is None


@given(slope=st.floats(-40, 40), sigma=st.floats(0.05, 10), zoom=st.floats(14, 19))
def test_arrows_point_uphill_where_the_sign_is_sure(slope: float, sigma: float, zoom: float) -> None:
    feature = {"highway": "residential", "slope_percent": slope, "slope_sigma_percent": sigma}
    arrow = drawn("light", "steepness", "uphill", feature, zoom)
    sure = bool(certain_signs(np.array([slope]), np.array([sigma]))[0])
    assert arrow is None or sure
    if zoom >= 16 and abs(slope) > 1:
        assert (arrow is not None) == sure
    if arrow is not None:
        # A line runs from from_node to to_node, and the sign points along it.
        assert evaluate(arrow["layout"]["icon-rotate"], feature) == (180 if slope < 0 else 0)
        assert arrow["layout"]["icon-rotation-alignment"] == "map"
    assert drawn("light", "steepness", "uphill", feature, 13.9) is None


@pytest.mark.parametrize(
    ("slope", "sigma", "zoom", "said"),
    [
        (-4.26, 0.31, 16, "4.3 %"),
        (12.7, 0.31, 16, "13 %"),
        (0.4, 0.31, 16, None),
        (0.4, 0.31, 17, "0.4 %"),
        (-4.26, 0.31, 18, "4.3 ± 0.3 %"),
        (4.26, 0.02, 18, "4.3 ± 0.02 %"),
        (4.26, 0.31, 15, None),
    ],
)
def test_figures_say_how_steep_it_is(slope: float, sigma: float, zoom: float, said: str | None) -> None:
    feature = {"highway": "residential", "slope_percent": slope, "slope_sigma_percent": sigma}
    layer = drawn("light", "steepness", "figures", feature, zoom)
    assert (layer and evaluate(layer["layout"]["text-field"], feature, zoom)) == said


def test_colours_on_dark_ground_and_of_certainty_are_those_of_matplotlib() -> None:
    for name, low, high, colours in (
        ("viridis", 0.3, 1.0, COLOURS_ON_DARK),
        ("plasma", 0.0, 0.85, SIGMA_COLOURS),
        ("plasma", 1.0, 0.25, SIGMA_COLOURS_ON_DARK),
    ):
        assert [to_hex(c) for c in colormaps[name](np.linspace(low, high, len(colours)))] == list(colours)


def test_places_go_above_names_of_streets_and_those_above_figures() -> None:
    order = [one["id"] for one in style_document(BASE, "light", "steepness")["layers"]]
    assert order[1] == "water"
    lines = max(k for k, one in enumerate(order) if one.startswith(("slope-", "unknown-")))
    above = ["uphill", "figures", "water-names", "street-names", "road-numbers", "places"]
    assert [one for one in order[lines:] if one in above] == above


@given(west=st.floats(-180, 179), width=st.floats(0, 180), south=st.floats(-90, 90), height=st.floats(0, 90))
def test_a_map_opens_with_all_of_the_network(west: float, width: float, south: float, height: float) -> None:
    east, north = min(west + width, 180.0), min(south + height, 90.0)
    view = first_view((west, south, east, north))
    (lon, lat), zoom = view["center"], view["zoom"]
    assert 0 <= zoom <= 14
    assert -85.1 <= lat <= 85.1
    half = 360 / 2**zoom
    assert zoom == 0 or (lon - half <= west + 1e-6 and lon + half >= east - 1e-6)


def test_the_style_is_served_whole_and_unchanged_answers_304(reading: Any) -> None:
    answer = reading.client.get("/style.json")
    assert answer.status_code == 200
    style = answer.json()
    assert style["sources"]["slopes"]["url"] == f"{reading.base}/tiles.json"
    assert len(style["center"]) == 2
    tile_json = reading.client.get(style["sources"]["slopes"]["url"]).json()
    (fields,) = [layer["fields"] for layer in tile_json["vector_layers"] if layer["id"] == LAYER]
    of_names = reading.client.get(style["sources"][NAMES]["url"]).json()["vector_layers"]
    known = {LAYER: set(fields)} | {layer["id"]: set(layer["fields"]) for layer in of_names}
    for layer in style["layers"][1:]:
        assert {*words(layer, "get"), *words(layer, "has")} <= known[layer["source-layer"]]
    again = reading.client.get("/style.json", headers={"If-None-Match": answer.headers["etag"]})
    assert (again.status_code, again.content) == (304, b"")
    dark = reading.client.get("/style.json", params={"theme": "dark", "colour": "certainty"})
    assert dark.headers["etag"] != answer.headers["etag"]
    assert dark.json()["name"] == "Versant: certainty, dark"


@pytest.mark.parametrize("query", ["theme=blue", "colour=", "colour=Steepness", "color=steepness", "f=json"])
def test_a_style_that_there_is_not_is_a_bad_query(reading: Any, query: str) -> None:
    problem = check(reading.client.get(f"/style.json?{query}"), 400)
    assert problem["errors"][0]["field"] == query.split("=", maxsplit=1)[0]
    assert any(word in problem["detail"] for word in ("light", "steepness", "colour, layer, theme"))


def test_ways_have_a_style_of_the_same_colours(reading: Any) -> None:
    style = reading.client.get("/style.json?layer=ways").json()
    assert {one["source-layer"] for one in style["layers"] if one.get("source") == "slopes"} == {"ways"}
    (layer,) = reading.client.get(style["sources"]["slopes"]["url"]).json()["vector_layers"]
    assert layer["id"] == "ways"
    check(reading.client.get("/style.json?layer=ways&colour=difference"), 400)
    check(reading.client.get("/style.json?layer=roads"), 400)


def test_a_map_of_no_roads_has_a_style(web: Any) -> None:
    assert "center" not in web.client.get("/style.json").json()


VALIDATE = """
import { pathToFileURL } from 'node:url';
import { createRequire } from 'node:module';
import fs from 'node:fs';
const found = createRequire(process.argv[1] + '/x.js').resolve('@maplibre/maplibre-gl-style-spec');
const { validateStyleMin } = await import(pathToFileURL(found));
const errors = validateStyleMin(JSON.parse(fs.readFileSync(0)));
console.log(JSON.stringify(errors.map((error) => error.message)));
"""


@pytest.fixture(scope="module")
def validator() -> Callable[[dict[str, Any]], list[str]]:
    """The specification's own validator, where Node and its package are (docs/how-to/connect-programs.md)."""
    node = shutil.which("node")
    if node is None:
        pytest.skip("Node is not installed")

    def validate(style: dict[str, Any]) -> list[str]:
        command = [node, "--input-type=module", "-e", VALIDATE, str(Path(__file__).resolve().parents[4])]
        done = subprocess.run(command, input=json.dumps(style), capture_output=True, text=True, check=False)
        if "MODULE_NOT_FOUND" in done.stderr:
            pytest.skip("@maplibre/maplibre-gl-style-spec is not installed where Node looks (NODE_PATH)")
        assert done.returncode == 0, done.stderr
        errors: list[str] = json.loads(done.stdout)
        return errors

    return validate


def test_the_reference_validator_finds_no_fault(validator: Callable[[dict[str, Any]], list[str]]) -> None:
    for theme, colour in EVERY:
        assert validator(style_document(BASE, theme, colour)) == []
    broken = style_document(BASE, "light", "steepness")
    broken["layers"][1]["paint"]["line-width"] = ["no-such-thing", 1]
    assert validator(broken) != []
