"""Constants that are tried one by one: all of them, where they are looked up, and put back."""

from __future__ import annotations

import importlib

import numpy as np
import pytest

from accuracy.constants import CHANGES, LEFT_OUT, Change, changed, module_of, places, set_to, times
from factor_support import street
from fusion.network import segment_slopes
from fusion.network.adjust import adjust
from fusion.profile import levels, noise, traversals
from street_support import EVERYTHING, ride

BELIEFS = ("road_beliefs", "drive_beliefs", "segment_slopes", "terrain")


@pytest.mark.parametrize("change", CHANGES, ids=lambda change: change.label)
def test_every_constant_is_looked_up_changed_and_put_back(change: Change) -> None:
    before = getattr(module_of(change), change.name)
    modules = places(change)
    with changed(change):
        assert all(getattr(module, change.name) == change.value(before) for module in modules)
        assert change.value(before) != before
    assert all(getattr(module, change.name) is before for module in modules)


def test_every_constant_of_the_model_is_tried_or_has_a_reason() -> None:
    tried = {c.name for c in CHANGES} | set(LEFT_OUT)
    for room in BELIEFS:
        module = importlib.import_module(f"fusion.network.{room}")
        own = {
            name
            for name, value in vars(module).items()
            if name.isupper()
            and not name.startswith("_")
            and isinstance(value, int | float | tuple)
            and not any(
                name in vars(importlib.import_module(f"fusion.network.{other}"))
                for other in ("pass_factor", "curve", "unknowns", "combine")
            )
        }
        assert own <= tried, room


def test_a_constant_is_changed_wherever_it_is_imported() -> None:
    (change,) = (c for c in CHANGES if c.label == "ROBUST_INFORMATION_LOSS off: 1")
    assert set(places(change)) == {levels, noise, traversals}


def test_a_change_is_felt_and_its_end_too() -> None:
    table = street(60.0, 50.0, 70.0)
    drives = {0: ride(table, EVERYTHING, 1)}
    (off,) = (c for c in CHANGES if c.label == "PLACE_SIGMA_M off: 0")
    usual = adjust(table, drives).slope_sigma_percent
    with changed(off):
        narrow = adjust(table, drives).slope_sigma_percent
    assert np.all(narrow < usual)
    assert np.array_equal(adjust(table, drives).slope_sigma_percent, usual)


def test_what_nobody_looks_up_is_refused() -> None:
    with pytest.raises(LookupError, match="has no constant"):
        places(Change("fusion.network.segment_slopes", "NO_SUCH", "doubled", times(2.0)))
    # The module's own text is a name that no function reads.
    with pytest.raises(LookupError, match="does nothing"):
        places(Change("fusion.network.segment_slopes", "__doc__", "off", set_to("")))


def test_a_failure_puts_the_constant_back() -> None:
    before = segment_slopes.PLACE_SIGMA_M
    (off,) = (c for c in CHANGES if c.label == "PLACE_SIGMA_M off: 0")
    with pytest.raises(RuntimeError), changed(off):
        raise RuntimeError
    assert before == segment_slopes.PLACE_SIGMA_M
