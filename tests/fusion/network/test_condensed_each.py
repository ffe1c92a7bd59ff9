"""All passes of some drives condensed at once are what each is by itself."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from factor_support import Sensors, driven, street
from fusion.network.condensed import CondensedPasses
from fusion.network.condensed_each import DrivePasses, condense_each
from fusion.network.curve import knot_length
from fusion.network.drive_constants import ConstantsInformation, marginals_of
from fusion.network.pass_factor import PassFactor

TABLE = street(55, 70, 120, 43, 70, 55)
ALL = Sensors(
    doppler=0.02, pitch=0.01, force=0.02, altitude_m=0.3, pressure_m=0.2, mount=0.03, bias=-0.01, lag_s=2.0,
    farther_m=3.0,
)  # fmt: skip
SENSORS = [ALL, Sensors(), Sensors(doppler=np.nan, pitch=0.01, mount=0.02), Sensors(altitude_m=0.5)]


def hills(row: int, at: np.ndarray) -> np.ndarray:
    return 300 + 4 * np.sin((100 * row + at) / 60)


def passes_of(seed: int, places: int, mounts: int) -> list[PassFactor]:
    """A drive with several kinds of sensors from part to part, over some segments twice."""
    rng = np.random.default_rng(seed)
    rows = [*range(len(TABLE)), 2, 3]
    parts = [driven(TABLE, [row], hills, SENSORS[int(rng.integers(len(SENSORS)))], rng)[0] for row in rows]
    return [replace(one, sequence=k, place=k // places, mount=k // mounts) for k, one in enumerate(parts)]


def whole(passes: list[PassFactor]) -> DrivePasses:
    """A drive of these passes alone."""
    lengths = [float(knot_length(TABLE.length_m[p.segment])) for p in passes]
    drive = ConstantsInformation.of_passes(passes)
    return DrivePasses(passes, lengths, marginals_of(passes), drive, len(passes))


@given(st.integers(0, 10_000), st.integers(1, 5), st.integers(2, 9))
def test_each_pass_says_what_it_says_by_itself(seed: int, places: int, mounts: int) -> None:
    passes = passes_of(seed, places, mounts)
    drive = ConstantsInformation.of_passes(passes)
    lengths = [float(knot_length(TABLE.length_m[p.segment])) for p in passes]
    others = passes_of(seed + 1, mounts, places)
    together, _ = condense_each([whole(passes), whole(others)])
    for one, length, found in zip(passes, lengths, together, strict=True):
        alone = CondensedPasses.of_drive([one], [1.0], drive, len(passes), length)
        for spec in fields(CondensedPasses):
            expected, value = getattr(alone, spec.name), getattr(found, spec.name)
            scale = float(np.max(np.abs(expected))) or 1.0
            assert np.allclose(value, expected, rtol=0, atol=1e-9 * scale), spec.name


def test_a_drive_may_say_nothing_of_its_constants() -> None:
    one = passes_of(1, 2, 9)[:1]
    drive = ConstantsInformation.of_passes(one)
    length = float(knot_length(TABLE.length_m[0]))
    ((found,),) = condense_each([whole(one)])
    alone = CondensedPasses.of_drive(one, [1.0], drive, 1, length)
    assert found.vector == pytest.approx(alone.vector)
    assert condense_each([whole([])]) == [[]]
    assert condense_each([]) == []
