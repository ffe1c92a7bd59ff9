"""Widenings are found where sigmas are too small and nowhere else; statistics count what they say."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fusion.network.repeats import (
    MOST_WIDENING,
    RepeatPairs,
    Widening,
    learn_widenings,
    repeat_statistics,
)
from fusion.types import Floats, Ints

SEGMENTS, COMMON = 20, 0.5


def repeats(
    rng: np.random.Generator, truth: dict[str, float], drives: int, wrong: float = 0.0
) -> RepeatPairs:
    """So many drives of each class over the same segments in an order of chance, each paired with the one before.

    A class's errors are ``truth`` times what it states, and half of their variance is common to all of a drive.
    ``wrong`` is the share of slopes that are another road's.
    """
    names, count = tuple(truth), drives * len(truth)
    of_class = rng.permutation(np.repeat(np.arange(len(truth)), drives))
    stated = rng.uniform(0.2, 1.0, (count, 1)) * rng.uniform(0.7, 1.4, (count, SEGMENTS))
    error = np.sqrt(COMMON) * rng.normal(size=(count, 1)) + np.sqrt(1 - COMMON) * rng.normal(
        size=stated.shape
    )
    slope = rng.normal(0, 5, SEGMENTS) + error * stated * np.array(list(truth.values()))[of_class, None]
    slope += np.where(rng.random(slope.shape) < wrong, 20.0, 0.0)
    before, after = np.divmod(np.arange((count - 1) * SEGMENTS), SEGMENTS)[0] + np.array([[0], [1]])
    segment = np.tile(np.arange(SEGMENTS), count - 1)
    drive = np.column_stack([before, after])
    n = len(segment)
    return RepeatPairs(
        names,
        segment,
        drive,
        of_class[drive],
        slope[drive, segment[:, None]],
        stated[drive, segment[:, None]],
        rng.uniform(5, 300, n),
        rng.uniform(2, 30, n),
        rng.integers(-1, 2, n),
        rng.integers(-1, 4, (n, 2)),
    )


def taken(pairs: RepeatPairs, rows: Ints) -> RepeatPairs:
    return RepeatPairs(pairs.names, *(getattr(pairs, f.name)[rows] for f in fields(RepeatPairs)[1:]))


def learned(pairs: RepeatPairs) -> dict[str, Widening]:
    return {one.name: one for one in learn_widenings(pairs)}


@pytest.mark.slow
def test_sigmas_that_are_half_of_the_truth_are_found_within_the_stated_sigma() -> None:
    """A law of chance over 150 deployments: beside an honest class, most of whose pairs are with the other one."""
    rng = np.random.default_rng(7)
    truth = {"honest": 1.0, "small": 2.0}
    off: dict[str, list[float]] = {name: [] for name in truth}
    widened = 0
    for _ in range(150):
        found = learned(repeats(rng, truth, drives=60))
        for name, true in truth.items():
            off[name].append((found[name].learned - true) / found[name].sigma)
        assert found["small"].applied > 1.4
        widened += found["honest"].applied > 1.2
    for values in off.values():
        assert abs(np.mean(values)) < 0.5
        assert 0.8 < np.std(values) < 1.3
        assert np.mean(np.abs(values) < 1.96) > 0.88
    assert widened < 10


def test_a_few_wrong_matches_change_little() -> None:
    rng = np.random.default_rng(3)
    found = learned(repeats(rng, {"one": 1.0}, drives=300, wrong=0.02))["one"]
    assert found.learned < 1.15


def test_a_class_of_few_drives_stays_as_it_is() -> None:
    rng = np.random.default_rng(5)
    found = learned(repeats(rng, {"rare": 5.0}, drives=6))["rare"]
    assert found.learned > 2.0
    assert found.applied == 1.0
    assert learn_widenings(taken(repeats(rng, {"none": 1.0}, drives=3), np.empty(0, np.int64))) == []


@given(st.integers(0, 2**32 - 1), st.floats(0.1, 9.0), st.floats(0.01, 100.0))
def test_order_sides_and_units_do_not_matter(seed: int, truth: float, unit: float) -> None:
    rng = np.random.default_rng(seed)
    pairs = repeats(rng, {"a": 1.0, "b": truth}, drives=6)
    found = learn_widenings(pairs)
    assert all(1 / MOST_WIDENING <= one.learned <= MOST_WIDENING and one.sigma > 0 for one in found)
    assert all(1.0 <= one.applied <= MOST_WIDENING for one in found)
    turned = taken(pairs, rng.permutation(len(pairs.segment)))
    turned = replace(
        turned,
        **{k: getattr(turned, k)[:, ::-1] for k in ("drives", "classes")},
        **{k: unit * getattr(turned, k)[:, ::-1] for k in ("slope_percent", "sigma_percent")},
    )
    for one, other in zip(found, learn_widenings(turned), strict=True):
        assert other.learned == pytest.approx(one.learned, rel=1e-3)
        assert other.sigma == pytest.approx(one.sigma, rel=1e-2)


def test_statistics_are_those_of_the_pairs() -> None:
    rng = np.random.default_rng(1)
    pairs = repeats(rng, {"a": 1.0, "b": 2.0}, drives=20)
    rows = repeat_statistics(pairs)
    by_group = {(row["kind"], row["group"]): row for row in rows}
    z: Floats = pairs.z()
    every = by_group["all", "all"]
    assert (every["pairs"], every["drive_pairs"], every["segments"]) == (39 * SEGMENTS, 39, SEGMENTS)
    assert every["rms_z"] == pytest.approx(np.sqrt(np.mean(z**2)))
    assert every["inside_share"] == pytest.approx(np.mean(np.abs(z) < 1.96))
    assert 1 / np.sqrt(2 * 39 * SEGMENTS) < every["rms_z_sigma"] < 1.0
    assert by_group["class", "a"]["rms_z"] < every["rms_z"] < by_group["class", "b"]["rms_z"]
    for kind in ("class", "speed", "length"):
        assert sum(row["pairs"] for row in rows if row["kind"] == kind) == len(z)
    same = pairs.direction == 1
    assert by_group["direction", "same"]["median_difference_percent"] == pytest.approx(
        np.median(np.abs(pairs.difference_percent[same]))
    )
    assert repeat_statistics(taken(pairs, np.empty(0, np.int64))) == []
