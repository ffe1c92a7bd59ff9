"""The registry refuses duplicates and answers unknown names with the known ones."""

import pytest

from fusion.errors import BadOptionsError, UnknownNameError
from fusion.registry import Registry, check_columns


def test_names_keep_their_order_and_duplicates_are_refused() -> None:
    things: Registry[int] = Registry("colour")
    things.add("red", 1)
    things.add("blue", 2)
    assert list(things) == ["red", "blue"]
    assert list(things.items()) == [("red", 1), ("blue", 2)]
    assert "red" in things
    assert len(things) == 2
    with pytest.raises(ValueError, match="'red' is registered twice"):
        things.add("red", 3)
    assert things["red"] == 1
    with pytest.raises(UnknownNameError, match=r"no colour called 'green'. Choose one of: red, blue\."):
        things["green"]


@pytest.mark.parametrize(
    ("wrong", "near"),
    [
        ("altitude", "alt_msl_m"),
        ("height", "height_ell_m"),
        ("Longitude", "lon_deg"),
        ("xspeed_mps", "speed_mps"),
    ],
)
def test_a_column_that_is_none_of_ours_is_refused_with_what_is_near(wrong: str, near: str) -> None:
    check_columns({near: "x"})
    with pytest.raises(BadOptionsError, match=f"{wrong}=x.*Did you mean {near}"):
        check_columns({wrong: "x"})
    with pytest.raises(BadOptionsError, match="names no column of the file"):
        check_columns({near: " "})
