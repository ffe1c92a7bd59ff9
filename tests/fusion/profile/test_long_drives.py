"""Drives so long that they are computed in pieces: the same result, and somebody may stop them at any moment."""

from __future__ import annotations

import copy
from collections import Counter

import numpy as np
import pytest

from factor_support import street
from fusion.filters import smoother
from fusion.methods.base import DriveResult
from fusion.network import pass_columns
from fusion.network.pass_columns import PackedPasses, encoded, portions_of, table_of
from fusion.network.pass_factor import PassFactor
from fusion.pipeline import run_drive
from fusion.profile import factors, method
from fusion.types import DriveLog
from profile_support import hills, street_log

STREET = street(*[60.0] * 18)
COUNT = 4
"""Times there and back."""


@pytest.fixture(scope="module")
def log() -> DriveLog:
    """Up and down the street, again and again, with all sensors."""
    speed = np.tile(np.repeat([10.0, 0.0, -10.0, 0.0], [100, 12, 100, 12]), COUNT)
    eased = np.convolve(np.pad(speed, (4, 4), mode="edge"), np.ones(9) / 9, "valid")
    along = 30.0 + np.concatenate([[0.0], np.cumsum(0.5 * (eased[1:] + eased[:-1]))])
    time = 1.7e9 + np.arange(float(len(along)))
    nose = np.where(eased < 0, -1.0, 1.0)
    return street_log(time, along, hills, np.random.default_rng(0), nose=nose)


@pytest.fixture(scope="module")
def whole(log: DriveLog) -> DriveResult:
    return run_drive(log, STREET, None)[1]


@pytest.fixture
def short_pieces(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(smoother, "PIECE_STEPS", 300)
    for module in (factors, pass_columns):
        monkeypatch.setattr(module, "PACKED_AT_ONCE", 20)
    monkeypatch.setattr(method, "BLOCK_SEGMENTS", 5)


@pytest.mark.usefixtures("short_pieces")
def test_pieces_give_what_the_whole_gives(log: DriveLog, whole: DriveResult) -> None:
    found = run_drive(log, STREET, None)[1]
    assert isinstance(found.factors, PackedPasses)
    assert len(found.factors) == len(whole.factors) > 100
    assert len(found.slopes) == len(whole.slopes)
    for one, other in zip(found.slopes, whole.slopes, strict=True):
        assert one.segment == other.segment
        assert abs(one.slope_percent - other.slope_percent) < 1e-4 * other.slope_sigma_percent
        assert one.slope_sigma_percent == pytest.approx(other.slope_sigma_percent, rel=1e-4)
        assert (one.observations, one.passes) == (other.observations, other.passes)
        assert (one.first_time_s, one.last_time_s) == (other.first_time_s, other.last_time_s)
    np.testing.assert_allclose(found.track.alt_m, whole.track.alt_m, atol=1e-4)
    np.testing.assert_allclose(found.track.alt_sigma_m, whole.track.alt_sigma_m, rtol=1e-4)
    assert found.report["sensors"].keys() == whole.report["sensors"].keys()
    assert found.report["passes_of_part_of_a_segment"] == whole.report["passes_of_part_of_a_segment"]


@pytest.mark.usefixtures("short_pieces")
def test_packed_passes_are_the_passes(whole: DriveResult) -> None:
    passes = tuple(whole.factors)
    packed = PackedPasses.of(portion for _, portion in portions_of(passes))
    stored = PassFactor.encode_all(passes)
    assert list(encoded(packed)) == stored
    assert [one.encode() for one in packed] == stored
    assert packed[-1].encode() == packed[len(passes) - 1].encode() == stored[-1]
    assert [one.encode() for one in packed[3:40]] == stored[3:40]
    assert [(one.segment, one.sequence) for one in packed] == [(one.segment, one.sequence) for one in passes]
    for name in ("segment", "first_time_s", "rows", "used", "walk_m2_per_s"):
        assert np.array_equal(getattr(packed.table, name), getattr(table_of(passes), name))
    moved = packed.over(np.arange(len(passes)))
    assert [one.segment for one in moved] == list(range(len(passes)))
    assert list(encoded(copy.deepcopy(packed))) == stored  # as it is sent to another process
    with pytest.raises(IndexError):
        packed[len(passes)]


@pytest.mark.usefixtures("short_pieces")
def test_every_stage_says_how_far_it_is_and_can_be_stopped(log: DriveLog) -> None:
    """Each time that anything is gone through, for a drive of a million positions takes half a second for it."""
    said: list[tuple[str, float]] = []
    run_drive(log, STREET, None, progress=lambda *now: said.append(now))
    shares = [share for _, share in said]
    assert shares == sorted(shares)
    times = Counter(stage for stage, _ in said)
    assert times["match"] >= 6
    assert times["smooth"] > 20
    assert times["factors"] >= 5
    assert times["slopes"] > 20

    class Removed(Exception):  # noqa: N818
        pass

    for stage in ("match", "smooth", "factors", "slopes"):
        (at,) = np.quantile([share for name, share in said if name == stage], [0.5])

        def stop(now: str, share: float, at: float = float(at), stage: str = stage) -> None:
            if now == stage and share >= at:
                raise Removed

        with pytest.raises(Removed):
            run_drive(log, STREET, None, progress=stop)
