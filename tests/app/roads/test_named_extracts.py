"""Which extract is named for a place."""

from __future__ import annotations

import pytest

from app.roads.named_extracts import MOST_NAMED, extract_words, extracts_over

PLACES = {
    (8.40, 49.01): "europe/germany/baden-wuerttemberg",
    (8.69, 49.41): "europe/germany/baden-wuerttemberg",
    (6.96, 50.94): "europe/germany/nordrhein-westfalen",
    (11.57, 48.14): "europe/germany/bayern",
    (13.40, 52.52): "europe/germany/berlin",
    (7.59, 47.56): "europe/switzerland",
    (16.37, 48.21): "europe/austria",
    (2.35, 48.86): "europe/france/ile-de-france",
    (-0.12, 51.51): "europe/united-kingdom/england",
    (-122.3, 47.6): "north-america/us/washington",
    (139.7, 35.7): "asia/japan/kanto",
    (151.2, -33.9): "australia-oceania/australia",
}


@pytest.mark.parametrize(("place", "name"), PLACES.items(), ids=PLACES.values())
def test_the_likeliest_comes_first(place: tuple[float, float], name: str) -> None:
    lon, lat = place
    found = extracts_over((lon, lat, lon + 0.02, lat + 0.02))
    assert found[0] == name
    assert len(found) <= MOST_NAMED
    assert name in extract_words((lon, lat, lon + 0.02, lat + 0.02))


def test_what_crosses_a_border_needs_a_larger_one() -> None:
    assert "europe/germany" in extracts_over((8.4, 49.0, 13.4, 52.5))
    assert extracts_over((-8.0, 37.0, 24.0, 54.0))[0] == "europe"


def test_where_none_is_known_the_box_is_said() -> None:
    box = (-140.1, 5.0, -140.0, 5.1)
    assert extracts_over(box) == ()
    assert "5.0 to 5.1 degrees north and -140.1 to -140.0" in extract_words(box)
