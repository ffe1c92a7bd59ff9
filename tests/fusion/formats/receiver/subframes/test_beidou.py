"""BeiDou subframes: only parts of one frame make an ephemeris, of both kinds of message."""

from __future__ import annotations

import numpy as np
import pytest

from fusion.formats.base import Notes
from fusion.formats.receiver.subframes import beidou
from fusion.formats.receiver.subframes.bits import MIXED, NOT_THEN, Pages, bits_of
from fusion.signals import BEIDOU, BEIDOU_LATE_S, WEEK_S
from fusion.simulate.write.ubx_navigation import d1_parts, d2_parts
from raw_support import random_kepler

BEGIN_S = 2250 * WEEK_S + 7200.0 + BEIDOU_LATE_S


def pages(number: int, seed: int = 1, begin_s: float = BEGIN_S) -> Pages:
    records = random_kepler(BEIDOU, [number], seed, BEGIN_S)
    encode = d2_parts if number < 6 or number > 58 else d1_parts
    sent = list(encode(records, np.array([begin_s])))
    bits = np.concatenate([bits_of(words, 30) for _, words in sent])
    n = len(bits)
    return Pages(np.full(n, number), bits, np.array([begin_s + over for over, _ in sent]), np.full(n, -7))


def joined(*parts: Pages) -> Pages:
    columns = zip(*((p.number, p.bits, p.near_s, p.channel) for p in parts), strict=True)
    return Pages(*(np.concatenate(c) for c in columns))


@pytest.mark.parametrize("number", [6, 58, 1, 5, 59, 63])
def test_both_kinds_are_told_apart_by_the_satellite(number: int) -> None:
    notes = Notes()
    found = beidou.read_beidou(pages(number), notes)
    assert found.number.tolist() == [number] and not notes.skipped


@pytest.mark.parametrize("number", [30, 3])
def test_parts_of_two_frames_make_none(number: int) -> None:
    first, second, notes = pages(number, 1), pages(number, 2, BEGIN_S + 30), Notes()
    cut = len(first.bits) // 2
    keep = np.arange(len(first.bits)) < cut
    assert len(beidou.read_beidou(joined(first.take(keep), second.take(~keep)), notes)) == 0
    assert notes.skipped == {MIXED: 1}


@pytest.mark.parametrize("number", [30, 3])
def test_another_week_is_refused(number: int) -> None:
    frame, notes = pages(number), Notes()
    frame.bits[0, 72 if number == 30 else 76] ^= 1
    assert len(beidou.read_beidou(frame, notes)) == 0
    assert notes.skipped == {NOT_THEN: 1}


def test_a_preamble_that_is_none_is_counted() -> None:
    frame, notes = pages(30), Notes()
    frame.bits[1, 2] ^= 1
    assert len(beidou.read_beidou(frame, notes)) == 0
    assert notes.skipped == {beidou.NO_HEAD: 1, MIXED: 1}
