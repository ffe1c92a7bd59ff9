"""GLONASS strings: pyrtklib's check of the Hamming code, dates, and strings that do not belong together."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from fusion.formats.base import Notes
from fusion.formats.receiver.subframes import glonass
from fusion.formats.receiver.subframes.bits import MIXED, NOT_THEN, Pages, bits_of, write
from fusion.signals import GLONASS_AHEAD_S, GlonassEphemerides, gps_from_unix, unix_from_gps
from fusion.simulate.write.ubx_navigation import string_parts
from raw_support import random_navigation

MIDNIGHT_S = 1_709_164_800.0 - GLONASS_AHEAD_S  # UTC of 2024-02-29 in Moscow


def states(seed: int = 1, utc_s: float = MIDNIGHT_S) -> GlonassEphemerides:
    return random_navigation(seed, float(gps_from_unix(np.array([utc_s]))[0])).glonass


def pages(records: GlonassEphemerides, begin_s: float) -> Pages:
    sent = list(string_parts(records, np.full(len(records), begin_s)))
    bits = np.concatenate([bits_of(words) for _, words in sent])
    near_s = np.repeat([begin_s + over for over, _ in sent], len(records))
    return Pages(np.tile(records.number, 4), bits, near_s, np.tile(records.channel, 4))


def begin_of(records: GlonassEphemerides, late_s: float = 0.0) -> float:
    utc_s = unix_from_gps(records.toe_s[:1])
    return float(gps_from_unix(np.floor((utc_s + late_s) / 30) * 30)[0])


@pytest.mark.parametrize("late_s", [-900.0, -30.0, 0.0, 870.0])
def test_states_around_midnight_in_moscow_keep_their_day(late_s: float) -> None:
    records, notes = states(), Notes()
    found = glonass.read_strings(pages(records, begin_of(records, late_s)), notes)
    assert found.toe_s.tolist() == records.toe_s.tolist() and not notes.skipped


def test_days_of_four_years() -> None:
    moscow_s = np.array(["1996-01-01", "2023-12-31", "2024-01-01", "2024-02-29"], "datetime64[s]").astype(
        float
    )
    assert glonass.day_of_four_years(moscow_s).tolist() == [1, 1461, 1, 60]


@given(arrays(np.uint8, (1, glonass.BITS), elements=st.integers(0, 1)), st.integers(0, 84))
def test_any_wrong_bit_is_seen(bits: np.ndarray, place: int) -> None:
    bits[:, 77:85] = glonass.check_bits(bits)
    broken = bits.copy()
    broken[0, place] ^= 1
    assert not np.array_equal(glonass.check_bits(broken), broken[:, 77:85])


def test_a_wrong_bit_costs_its_satellite() -> None:
    records, notes = states(), Notes()
    frame = pages(records, begin_of(records))
    frame.bits[4, 30] ^= 1
    found = glonass.read_strings(frame, notes)
    assert found.number.tolist() == records.number[[0, 2]].tolist()
    assert notes.skipped == {glonass.WRONG_CODE: 1, MIXED: 1}


def resealed(frame: Pages, layout: dict[str, object], values: dict[str, float], string: int) -> Pages:
    """A field of one string changed, with the right checksum."""
    bits = frame.bits.copy()
    rows = np.arange(3 * (string - 1), 3 * string)
    part = bits[rows]
    write(part, layout, {name: np.full(3, value) for name, value in values.items()})  # type: ignore[arg-type]
    part[:, 77:85] = glonass.check_bits(part)
    bits[rows] = part
    return Pages(frame.number, bits, frame.near_s, frame.channel)


@pytest.mark.parametrize(
    ("string", "name", "value", "reason"),
    [
        (4, "day", 3.0, NOT_THEN),
        (1, "hour", 7.0, NOT_THEN),
        (2, "quarter", 110.0, NOT_THEN),
        (4, "slot", 12.0, glonass.OTHER_SLOT),
        (3, "frame", 99.0, MIXED),
    ],
)
def test_what_does_not_agree_is_refused(string: int, name: str, value: float, reason: str) -> None:
    records, notes = states(), Notes()
    frame = pages(records, begin_of(records))
    layout = {"frame": glonass.FRAME} if name == "frame" else {name: glonass.PARTS[string][name]}
    assert len(glonass.read_strings(resealed(frame, layout, {name: value}, string), notes)) == 0
    assert notes.skipped[reason] == 3
