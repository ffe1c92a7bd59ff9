"""RXM-SFRBX: ephemerides of every system out of frames, as pyrtklib reads them; nothing wrong out of hostile bytes."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace

import numpy as np
import pyrtklib
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fusion.formats import read_log
from fusion.formats.receiver.subframes.bits import MIXED, NOT_THEN
from fusion.formats.receiver.ubx_frames import find_frames, frame
from fusion.formats.receiver.ubx_subframes import NO_EPOCH, UNKNOWN_SATELLITE, WRONG_LENGTH
from fusion.signals import GALILEO, GPS, WEEK_S, Navigation, RawGnss
from fusion.simulate.write.ubx_file import in_order, raw_messages
from fusion.types import DriveLog
from raw_support import (
    START_GPS_S,
    by_satellite,
    glonass_from,
    kepler_from,
    random_navigation,
    satellite_of,
    signals_of,
)

SFRBX = 0x0213


@pytest.fixture(scope="module")
def sample() -> bytes:
    navigation = random_navigation(5)
    return in_order(raw_messages(RawGnss(signals_of(navigation, 5), navigation)))


def navigation_of(log: DriveLog) -> Navigation:
    assert log.raw is not None
    return log.raw.navigation


def changed(sample: bytes, edit: Callable[[bytearray], bytearray | None]) -> bytes:
    """The stream with each RXM-SFRBX payload as ``edit`` gives it back (None: left out)."""
    out, frames = b"", find_frames(sample)
    for start, end, kind in zip(frames.start, frames.end, frames.kind, strict=True):
        if kind != SFRBX:
            out += sample[start:end]
            continue
        payload = edit(bytearray(sample[start + 6 : end - 2]))
        out += b"" if payload is None else frame(2, 0x13, bytes(payload))
    return out


def only_subframes(sample: bytes) -> bytes:
    frames = find_frames(sample)
    spans = zip(frames.start, frames.end, frames.kind, strict=True)
    return b"".join(sample[start:end] for start, end, kind in spans if kind == SFRBX)


def gps_subframe(payload: bytearray) -> int:
    """Which subframe of GPS a payload holds, 0 for other systems: bits 8 to 10 of the second word."""
    return int.from_bytes(payload[12:16], "little") >> 8 & 7 if payload[0] == 0 else 0


def test_pyrtklib_reads_the_same_ephemerides(sample: bytes) -> None:
    raw = pyrtklib.raw_t()
    pyrtklib.init_raw(raw, pyrtklib.STRFMT_UBX)
    kepler, states = {}, {}
    for byte in sample:
        if pyrtklib.input_ubx(raw, byte) == 2:
            system, number = satellite_of(raw.ephsat)
            if system == 1:
                states[number] = raw.nav.geph[number - 1]
            else:
                kepler[system, number] = raw.nav.eph[raw.ephsat - 1]
    ours = navigation_of(read_log(sample))
    told = by_satellite(kepler_from(list(kepler.values())))
    mine = by_satellite(ours.kepler)
    without = mine["system"] != GALILEO  # it wants words of Galileo that hold no ephemeris; see test_inav
    assert without.sum() == len(kepler) == 10
    for name in told:
        if name not in ("sent_s", "accuracy_m", "healthy"):
            assert mine[name][without] == pytest.approx(told[name], rel=1e-12), name
    theirs, own = by_satellite(glonass_from(list(states.values()))), by_satellite(ours.glonass)
    assert len(states) == 3
    for name in theirs:
        if name != "healthy":
            assert own[name] == pytest.approx(theirs[name], rel=1e-12), name


def test_each_issue_is_given_once_and_a_change_of_health_again(sample: bytes) -> None:
    kepler = navigation_of(read_log(sample)).kepler
    names = list(zip(kepler.system.tolist(), kepler.number.tolist(), strict=True))
    assert len(set(names)) == len(names) == 13
    number = int(kepler.number[np.flatnonzero((kepler.system == GPS) & kepler.healthy)[0]])
    frames_seen = []

    def worse(payload: bytearray) -> bytearray:
        if payload[1] == number and gps_subframe(payload) == 1:
            frames_seen.append(1)
            if len(frames_seen) > 1:
                payload[17] |= 0x3F  # the health stands in bits 8 to 13 of the third word
        return payload

    again = navigation_of(read_log(changed(sample, worse))).kepler
    assert len(frames_seen) > 1 and len(again) == 14
    assert again.healthy[(again.system == GPS) & (again.number == number)].tolist() == [True, False]


def test_week_roll_overs_are_resolved_by_the_epochs() -> None:
    for week in (1023, 1024, 2047, 2048, 2049, 3072):
        start = week * WEEK_S - 40.0
        navigation = random_navigation(week, start)
        sample = in_order(raw_messages(RawGnss(signals_of(navigation, 1, 90, start), navigation)))
        log = read_log(sample)
        found = by_satellite(navigation_of(log).kepler)
        assert not log.skipped
        assert np.array_equal(found["toe_s"], by_satellite(navigation.kepler)["toe_s"])


def test_messages_of_another_time_are_left_out_and_counted(sample: bytes) -> None:
    late = random_navigation(5)
    moved = in_order(raw_messages(RawGnss(signals_of(late, 5, 61, START_GPS_S + 40_000), late)))
    log = read_log(changed(sample, lambda _: None) + only_subframes(moved))
    assert len(navigation_of(log)) == 0
    assert log.skipped[NOT_THEN] > 30


def test_a_week_that_is_not_that_of_the_epochs_is_refused(sample: bytes) -> None:
    def other(payload: bytearray) -> bytearray:
        if gps_subframe(payload) == 1:
            payload[19] ^= 0x04
        return payload

    log = read_log(changed(sample, other))
    assert not np.any(navigation_of(log).kepler.system == GPS)
    assert log.skipped[NOT_THEN] == 3


def test_issues_that_are_mixed_give_no_ephemeris(sample: bytes) -> None:
    def mixed(payload: bytearray) -> bytearray:
        if gps_subframe(payload) == 2:
            payload[19] ^= 0x20  # the first word of subframe 2 begins with its issue
        return payload

    log = read_log(changed(sample, mixed))
    assert not np.any(navigation_of(log).kepler.system == GPS)
    assert log.skipped[MIXED] == 3


def test_wrong_lengths_and_satellites_are_counted(sample: bytes) -> None:
    log = read_log(sample + frame(2, 0x13, bytes([0, 3, 0, 0, 10, 0, 2, 0]) + bytes(36)))
    assert log.skipped[WRONG_LENGTH] == 1
    log = read_log(sample + frame(2, 0x13, bytes([6, 255, 0, 7, 4, 0, 2, 0]) + bytes(16)))
    assert log.skipped[UNKNOWN_SATELLITE] == 1
    log = read_log(sample + frame(2, 0x13, bytes([0, 3])))
    assert log.skipped["RXM-SFRBX messages too short"] == 1


@pytest.mark.parametrize("seed", range(12))
def test_random_words_give_no_ephemeris_and_no_error(sample: bytes, seed: int) -> None:
    """Flipped bits: parity is the receiver's to check, so only heads, weeks, issues and checksums can tell here."""
    rng = np.random.default_rng(seed)

    def noise(payload: bytearray) -> bytearray:
        payload[8:] = rng.bytes(len(payload) - 8)
        return payload

    log = read_log(changed(sample, noise))
    assert len(navigation_of(log)) == 0 and log.skipped


@settings(max_examples=60, deadline=None)
@given(st.binary(min_size=0, max_size=60))
def test_any_bytes_are_read_or_counted(sample: bytes, payload: bytes) -> None:
    assert len(navigation_of(read_log(sample + frame(2, 0x13, payload)))) == 16


def test_subframes_without_any_epoch_are_counted(sample: bytes, make: SimpleNamespace) -> None:
    undated = make.pvt(validDate=0, validTime=0, fullyResolved=0)
    log = read_log(undated + only_subframes(sample))
    assert log.raw is None and log.skipped[NO_EPOCH] > 0
