"""The registry refuses duplicates and answers unknown names with the known ones."""

import pytest

from fusion.errors import UnknownNameError
from fusion.registry import Registry


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
