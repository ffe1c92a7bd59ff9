"""GPS subframes: real broadcasts sent and read again, the ionosphere, and heads that are none."""

from __future__ import annotations

import numpy as np
import pytest

from fusion.formats.base import Notes
from fusion.formats.receiver.subframes import lnav
from fusion.formats.receiver.subframes.bits import MIXED, NOT_THEN, Pages, bits_of
from fusion.signals import GPS, KeplerEphemerides
from fusion.simulate.write.ubx_navigation import lnav_parts
from raw_support import BROADCASTS, START_GPS_S, broadcast, by_satellite, random_kepler

BEGIN_S = START_GPS_S - START_GPS_S % 30


def pages(records: KeplerEphemerides, begin_s: np.ndarray) -> Pages:
    """Subframes 1 to 3 of each record, in the order of sending."""
    sent = list(lnav_parts(records, begin_s))
    bits = np.concatenate([bits_of(words, 30) for _, words in sent])
    over_s = np.concatenate([begin_s + over for over, _ in sent])
    order = np.argsort(over_s, kind="stable")
    return Pages(
        np.tile(records.number, len(sent))[order], bits[order], over_s[order], np.full(len(bits), -7)
    )


def test_real_broadcasts_come_back_to_the_digits_of_their_file() -> None:
    if not (BROADCASTS / "brdc1180.21n").exists():
        pytest.skip("needs ../shared/data/gnss")
    records = broadcast("brdc1180.21n").kepler
    begin_s = np.floor(records.toe_s / 30) * 30 - 7200.0
    found, _ = lnav.read_lnav(pages(records, begin_s), GPS, Notes())
    back, sent = by_satellite(found), by_satellite(records)
    assert len(found) == len(records) > 100
    fields = {name: field for part in lnav.PARTS.values() for name, field in part.items()}
    for name in back:
        if name == "sent_s":
            continue
        step = fields[name].scale if name in fields else 0.0
        assert back[name] == pytest.approx(sent[name], rel=1e-11, abs=step / 1000), name
        if name in fields:  # a file's twelve digits hold the very number that was sent
            steps = sent[name] / fields[name].scale
            assert np.abs(steps - np.round(steps)).max() < 0.01, name


@pytest.mark.parametrize("place", [0, 3, 18 * 30 + 5])
def test_a_head_that_is_none_is_counted(place: int) -> None:
    frame, notes = pages(random_kepler(GPS, [5], 1, BEGIN_S), np.array([BEGIN_S])), Notes()
    frame.bits[place // (18 * 30), place % 30] ^= 1
    assert len(lnav.read_lnav(frame, GPS, notes)[0]) == 0
    assert notes.skipped[lnav.NO_HEAD] == 1 and notes.skipped[MIXED] == 1


def test_a_count_of_another_hour_is_refused() -> None:
    frame, notes = pages(random_kepler(GPS, [5], 1, BEGIN_S), np.array([BEGIN_S])), Notes()
    late = Pages(frame.number, frame.bits, frame.near_s + 3600, frame.channel)
    assert len(lnav.read_lnav(late, GPS, notes)[0]) == 0
    assert notes.skipped == {NOT_THEN: 3}
