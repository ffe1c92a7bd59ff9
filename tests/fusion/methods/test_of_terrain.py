"""Methods that lean on the elevation model are named as such: together they are one source."""

from __future__ import annotations

from fusion.catalogue import METHODS
from fusion.methods.base import OF_TERRAIN


def test_they_are_those_that_cannot_do_without_one() -> None:
    assert set(OF_TERRAIN) == {name for name in METHODS if "a DEM" in METHODS[name].needs}
