"""Navigation messages: whatever ephemerides are sent come back to the last bit, random ones and real ones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fusion.formats import read_log
from fusion.signals import BEIDOU, GALILEO, GPS, QZSS, WEEK_S, Navigation, RawGnss
from fusion.simulate.write.ubx_file import in_order, raw_messages
from raw_support import BROADCASTS, START_GPS_S, broadcast, by_satellite, random_navigation, signals_of


def read_back(navigation: Navigation, epochs: int = 61, start_s: float = START_GPS_S) -> Navigation:
    """What a reader finds of it in a simulated file; nothing may be left out."""
    log = read_log(in_order(raw_messages(RawGnss(signals_of(navigation, 1, epochs, start_s), navigation))))
    assert log.raw is not None and not log.skipped and not log.warnings
    return log.raw.navigation


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 2**31), st.integers(0, 7 * 86400 - 1))
def test_every_field_comes_back_to_the_last_bit(seed: int, second: int) -> None:
    start_s = 2250 * WEEK_S + second
    sent = random_navigation(seed, start_s)
    found = read_back(sent, start_s=start_s)
    assert found.klobuchar == sent.klobuchar
    for ours, theirs in ((found.kepler, sent.kepler), (found.glonass, sent.glonass)):
        back, wanted = by_satellite(ours), by_satellite(theirs)
        for name in wanted:
            if name != "sent_s":
                assert back[name].tolist() == wanted[name].tolist(), name


def test_the_time_of_sending_is_the_frames() -> None:
    kepler = read_back(random_navigation(4)).kepler
    after_s = kepler.sent_s - np.floor(START_GPS_S / 30) * 30
    assert set(after_s[np.isin(kepler.system, (GPS, QZSS))]) == {0.0}
    assert set(after_s[kepler.system == GALILEO]) == {8.0}  # word 5 is the fifth page
    assert set(after_s[kepler.system == BEIDOU]) == {14.0}


def test_unknown_numbers_are_sent_as_such() -> None:
    sent = random_navigation(4)
    kepler = replace(
        sent.kepler,
        accuracy_m=np.full(len(sent.kepler), np.nan),
        group_delay_s=np.full(len(sent.kepler), np.nan),
    )
    found = read_back(replace(sent, kepler=kepler)).kepler
    assert np.isnan(found.accuracy_m).all() and not found.group_delay_s.any()


@pytest.mark.parametrize(
    "name", ["BRDC00WRD_S_20230730000_01D_MN.rnx", "brdc1180.21n", "brdc1370.20g", "brdc1370.20n"]
)
def test_real_broadcasts_come_back_to_the_digits_of_their_file(name: str) -> None:
    if not (BROADCASTS / name).exists():
        pytest.skip("needs ../shared/data/gnss")
    everything = broadcast(name)
    kepler, states = everything.kepler, everything.glonass
    firsts = np.unique(np.column_stack([kepler.system, kepler.number]), axis=0, return_index=True)[1]
    some = Navigation(
        type(kepler)(**{k: column[firsts] for k, column in vars(kepler).items()}),
        type(states)(
            **{k: v[np.unique(states.number, return_index=True)[1]] for k, v in vars(states).items()}
        ),
    )
    toe_s = np.concatenate([some.kepler.toe_s, some.glonass.toe_s])
    found = read_back(some, 61, float(np.median(toe_s)))
    assert len(found) == len(some) > 0
    for ours, theirs in ((found.kepler, some.kepler), (found.glonass, some.glonass)):
        back, wanted = by_satellite(ours), by_satellite(theirs)
        for column in wanted:
            if column not in ("sent_s", "accuracy_m"):
                step = 1e-12 if column == "group_delay_s" else 1e-20  # which some files round to seven digits
                assert back[column] == pytest.approx(wanted[column], rel=1e-11, abs=step), column
