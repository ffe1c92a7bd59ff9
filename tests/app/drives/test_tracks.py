"""A track survives its way through the database bit for bit, measurements to single precision."""

from __future__ import annotations

import uuid
from collections.abc import Callable
from dataclasses import fields

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from app.core.db import Sessions
from app.drives import tracks
from fusion.types import DrawnMeasurements, Ints, Track


def make_track(values: np.ndarray, segment: np.ndarray, has_gnss: np.ndarray) -> Track:
    columns = iter(values.T)
    return Track(
        **{
            spec.name: segment
            if spec.name == "segment"
            else has_gnss
            if spec.name in ("has_gnss", "after_outage")
            else next(columns)
            for spec in fields(Track)
        }
    )


@given(st.integers(0, 30).flatmap(lambda n: st.tuples(
    hnp.arrays(float, (n, len(fields(Track)) - 3), elements=st.floats(allow_nan=True)),
    hnp.arrays(np.int64, n, elements=st.integers(-1, 4)),
    hnp.arrays(bool, n),
)))  # fmt: skip
def test_what_is_decoded_is_what_was_encoded(parts: tuple[np.ndarray, np.ndarray, np.ndarray]) -> None:
    values, segment, has_gnss = parts
    track = make_track(values, segment, has_gnss)
    ids = np.array([11, 22, 33, 44, 55])
    stored = tracks.decode(tracks.encode(track, ids))
    for spec in fields(Track):
        back, sent = getattr(stored, spec.name), getattr(track, spec.name)
        assert back.dtype == sent.dtype
        if spec.name != "segment":
            assert back.tobytes() == np.ascontiguousarray(sent).tobytes()
    assert stored.segment.tolist() == [ids[s] if s >= 0 else -1 for s in segment]


def test_a_later_track_replaces_the_former(
    sessions: Sessions, segment_ids: Ints, add_drive: Callable[..., uuid.UUID]
) -> None:
    drive = add_drive(segment_ids, {0: (1.0, 1.0)})
    columns = len(fields(Track)) - 3
    with sessions.begin() as session:
        assert tracks.read_track(session, drive) is None
        for n in (5, 3):
            track = make_track(np.ones((n, columns)), np.zeros(n, int), np.ones(n, bool))
            tracks.save_track(session, drive, tracks.EncodedTrack.of(track, segment_ids))
        stored = tracks.read_track(session, drive)
    assert stored is not None
    assert stored.segment.tolist() == [segment_ids[0]] * 3


def make_measurements(sensor: np.ndarray, values: np.ndarray) -> DrawnMeasurements:
    names = ("altitude", "doppler", "barometer", "pitch")
    return DrawnMeasurements(names, sensor, *values.T, np.array([True, False, True, False])[sensor])  # type: ignore[call-arg]


@given(st.integers(0, 30).flatmap(lambda n: st.tuples(
    hnp.arrays(np.int64, n, elements=st.integers(0, 3)),
    hnp.arrays(float, (n, 3), elements=st.floats(-1e6, 2e9, allow_nan=False)),
)))  # fmt: skip
def test_measurements_come_back_as_they_were(parts: tuple[np.ndarray, np.ndarray]) -> None:
    sent = make_measurements(*parts)
    back = tracks.decode_measurements(tracks.encode_measurements(sent))
    assert back.names == sent.names
    for name in ("sensor", "time_s", "is_height"):
        assert getattr(back, name).dtype == getattr(sent, name).dtype
        assert getattr(back, name).tolist() == getattr(sent, name).tolist()
    for name in ("along_m", "value"):
        assert getattr(back, name).tolist() == getattr(sent, name).astype(np.float32).tolist()


def test_a_later_run_replaces_the_measurements_and_may_have_none(
    sessions: Sessions, segment_ids: Ints, add_drive: Callable[..., uuid.UUID]
) -> None:
    drive = add_drive(segment_ids, {0: (1.0, 1.0)})
    track = make_track(np.ones((2, len(fields(Track)) - 3)), np.zeros(2, int), np.ones(2, bool))
    with sessions.begin() as session:
        assert tracks.read_measurements(session, drive) is None
        for sent in (make_measurements(np.array([0, 3, 0]), np.ones((3, 3))), None):
            tracks.save_track(session, drive, tracks.EncodedTrack.of(track, segment_ids, sent))
            back = tracks.read_measurements(session, drive)
            assert (back is None) == (sent is None)
            assert back is None or back.value.tolist() == [1.0, 1.0, 1.0]
        assert tracks.read_track(session, drive) is not None
