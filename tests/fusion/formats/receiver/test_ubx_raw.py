"""RXM-RAWX: measurements as pyubx2 and a real receiver's own listing have them, and what is left out and counted."""

from __future__ import annotations

import csv
import io
import struct
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from pyubx2 import UBXReader

from fusion.errors import EmptyLogError
from fusion.formats import read_log
from fusion.formats.receiver import ubx_raw
from fusion.formats.receiver.ubx_frames import frame
from fusion.signals import BEIDOU, GALILEO, GLONASS, GPS, LIGHT_MPS, QZSS, WEEK_S, RawGnss, Signals
from fusion.simulate.write.ubx_file import in_order, raw_messages
from fusion.types import DriveLog
from raw_support import random_navigation, signals_of
from source_tree import REPOSITORY

SMARTLOC = Path(REPOSITORY).parent / "shared/data/smartloc/tu_chemnitz_berlin_1_raw.csv"
TOW_S, WEEK = 126_641.5, 1900


def measurement(range_m: float = 2.1e7, gnss: int = 0, satellite: int = 5, **other: float) -> bytes:
    """One block; fields not given are those of a good GPS measurement."""
    field = {"doppler": -1500.0, "signal": 0, "freq": 0, "cno": 41, "sigma": 5, "track": 15} | other
    return struct.pack(
        "<ddfBBBBHBBBBBB", range_m, 1e8, field["doppler"], gnss, satellite, int(field["signal"]), int(field["freq"]),
        64500, int(field["cno"]), int(field["sigma"]), 4, 7, int(field["track"]), 0,
    )  # fmt: skip


def epoch(*blocks: bytes, tow_s: float = TOW_S, week: int = WEEK, version: int = 1, **other: int) -> bytes:
    """One message; ``said`` measurements are stated."""
    head = struct.pack(
        "<dHbBBBH", tow_s, week, 17, other.get("said", len(blocks)), other.get("status", 1), version, 0
    )
    return frame(2, 0x15, head + b"".join(blocks))


def signals(log: DriveLog) -> Signals:
    assert log.raw is not None
    return log.raw.signals


def test_numbers_agree_with_pyubx2() -> None:
    navigation = random_navigation(3)
    sample = in_order(raw_messages(RawGnss(signals_of(navigation, 3, 5), navigation)))
    messages = [m for _, m in UBXReader(io.BytesIO(sample)) if m.identity == "RXM-RAWX"]
    found = signals(read_log(sample))
    told = []
    for m in messages:
        assert (m.leapS, m.leapSec, m.payload[13]) == (18, 1, 1)
        for k in range(1, m.numMeas + 1):
            names = ("prMes", "doMes", "gnssId", "svId", "freqId", "cno", "prStd", "prValid")
            told.append([m.week * WEEK_S + m.rcvTow, *(getattr(m, f"{name}_{k:02d}") for name in names)])
    table = np.array(told, float)
    system = np.array([GPS, -1, GALILEO, BEIDOU, -1, QZSS, GLONASS])[table[:, 3].astype(int)]
    table, system = (c[np.lexsort((table[:, 4], system, table[:, 0]))] for c in (table, system))
    assert found.system.tolist() == system.tolist() and found.number.tolist() == table[:, 4].tolist()
    assert found.gps_s[found.epoch].tolist() == table[:, 0].tolist()
    assert found.pseudorange_m.tolist() == table[:, 1].tolist()
    assert -found.range_rate_mps * found.frequency_hz / LIGHT_MPS == pytest.approx(table[:, 2], abs=1e-3)
    assert found.cn0_dbhz.tolist() == table[:, 6].tolist()
    assert found.sigma_m == pytest.approx(0.01 * 2.0 ** table[:, 7])


def test_a_real_receiver_s_own_listing_comes_back() -> None:
    if not SMARTLOC.exists():
        pytest.skip("needs ../shared/data/smartloc")
    with SMARTLOC.open(encoding="utf-8") as file:
        rows = list(csv.reader(file, delimiter=";"))[1:]
    names = {"GPS": 0, "SBAS": 1, "Glonass": 6}
    epochs: dict[float, list[list[str]]] = {}
    for row in rows:
        epochs.setdefault(float(row[16]), []).append(row)
    sample = b"".join(
        epoch(
            *(
                measurement(
                    float(r[21]), names[r[24]], int(r[25]), doppler=float(r[23]), freq=int(r[26]), cno=float(r[28]),
                    sigma=round(np.log2(float(r[29]) / 0.01)), track=int(r[32]),
                )
                for r in group
            ),
            tow_s=tow_s, version=0,
        )
        for tow_s, group in epochs.items()
    )  # fmt: skip
    found = signals(read_log(sample))
    kept = [r for r in rows if r[24] != "SBAS"]
    assert (len(found), len(found.system)) == (31, len(kept))
    assert found.gps_s.tolist() == [WEEK * WEEK_S + t for t in epochs]
    assert sorted(found.pseudorange_m) == sorted(float(r[21]) for r in kept)
    assert sorted(found.sigma_m) == pytest.approx(sorted(float(r[29]) for r in kept))
    moving = {(float(r[21])): (float(r[23]), r[24], int(r[26])) for r in kept}
    for range_m, rate, hertz in zip(
        found.pseudorange_m, found.range_rate_mps, found.frequency_hz, strict=True
    ):
        doppler, system, channel = moving[range_m]
        carrier = 1575.42e6 if system == "GPS" else 1602e6 + 562_500 * (channel - 7)
        assert hertz == carrier
        assert rate == pytest.approx(-LIGHT_MPS / carrier * doppler, rel=1e-6)
    assert np.all(np.abs(found.range_rate_mps) < 1000)


def test_one_row_by_hand() -> None:
    log = read_log(epoch(measurement(2.2e7, 6, 12, freq=2, doppler=1000.0, sigma=0x47, cno=0)))
    one = signals(log)
    assert (one.system.tolist(), one.number.tolist(), one.sigma_m.tolist()) == ([GLONASS], [12], [1.28])
    assert one.frequency_hz.tolist() == [1602e6 - 5 * 562_500]
    assert one.range_rate_mps[0] == pytest.approx(-1000 * 299792458 / (1602e6 - 5 * 562_500))
    assert np.isnan(one.cn0_dbhz[0])
    assert len(log.fix) == 0 and log.source_format == "ubx"


def test_the_l1_band_alone_is_read() -> None:
    wanted = [(0, 0), (2, 0), (2, 1), (3, 0), (3, 1), (5, 0), (6, 0)]
    others = [(0, 3), (0, 4), (2, 5), (3, 2), (3, 5), (5, 1), (6, 2), (1, 0), (4, 0), (7, 0), (99, 0)]
    for gnss, signal in wanted + others:
        block = measurement(2.2e7, gnss, 3, signal=signal)
        log = read_log(epoch(measurement(), block))
        assert len(signals(log).system) == 1 + ((gnss, signal) in wanted), (gnss, signal)
        assert not log.skipped
    reserved = read_log(epoch(measurement(), measurement(2.2e7, 0, 3, signal=3), version=0))
    assert len(signals(reserved).system) == 2  # what version 0 has there is no signal number


@pytest.mark.parametrize(
    ("block", "reason"),
    [
        (measurement(satellite=33), ubx_raw.NO_SATELLITE),
        (measurement(satellite=0), ubx_raw.NO_SATELLITE),
        (measurement(gnss=6, satellite=255), ubx_raw.NO_SATELLITE),
        (measurement(gnss=6, freq=14), ubx_raw.NO_SATELLITE),
        (measurement(track=14), ubx_raw.NOT_VALID),
        (measurement(float("nan")), ubx_raw.NO_RANGE),
        (measurement(float("inf")), ubx_raw.NO_RANGE),
        (measurement(-2e7), ubx_raw.NO_RANGE),
        (measurement(1e300), ubx_raw.NO_RANGE),
    ],
)
def test_impossible_measurements_are_counted(block: bytes, reason: str) -> None:
    log = read_log(epoch(measurement(satellite=7), block))
    assert signals(log).number.tolist() == [7] and log.skipped == {reason: 1}


@pytest.mark.parametrize("doppler", [float("nan"), float("inf"), 1e30])
def test_an_impossible_doppler_is_unknown(doppler: float) -> None:
    assert np.isnan(signals(read_log(epoch(measurement(doppler=doppler)))).range_rate_mps[0])


@pytest.mark.parametrize(
    ("message", "reason"),
    [
        (epoch(measurement(), said=2), ubx_raw.WRONG_LENGTH),
        (epoch(measurement(), measurement(satellite=8), said=1), ubx_raw.WRONG_LENGTH),
        (epoch(measurement(), week=0), ubx_raw.NO_WEEK),
        (epoch(measurement(), tow_s=float("nan")), ubx_raw.NO_TIME),
        (epoch(measurement(), tow_s=-1.0), ubx_raw.NO_TIME),
        (epoch(measurement(), tow_s=604_800.0), ubx_raw.NO_TIME),
        (epoch(measurement(), week=65_535), ubx_raw.NO_TIME),
    ],
)
def test_unusable_epochs_are_counted_and_said(message: bytes, reason: str) -> None:
    log = read_log(epoch(measurement(), tow_s=TOW_S + 1) + message)
    assert len(signals(log)) == 1 and log.skipped == {reason: 1}
    assert any(reason in warning for warning in log.warnings)
    with pytest.raises(EmptyLogError, match="byte 0"):
        read_log(message)


def test_epochs_that_go_back_are_sorted_and_said() -> None:
    log = read_log(b"".join(epoch(measurement(2e7 + t), tow_s=TOW_S + t) for t in (5, 6, 7, 1, 2)))
    assert (signals(log).gps_s - WEEK * WEEK_S - TOW_S).tolist() == [1, 2, 5, 6, 7]
    assert signals(log).pseudorange_m.tolist() == [2e7 + t for t in (1, 2, 5, 6, 7)]
    assert log.repaired[ubx_raw.BACKWARDS] == 1
    assert any("started again" in warning for warning in log.warnings)


def test_of_epochs_at_one_time_each_satellite_counts_once() -> None:
    log = read_log(epoch(measurement(2e7)) + epoch(measurement(2.1e7), measurement(satellite=9)))
    assert len(signals(log)) == 1 and signals(log).pseudorange_m.tolist() == [2e7, 2.1e7]
    assert log.repaired[ubx_raw.REPEATED] == 1


def test_measurements_date_a_log_without_navigation_messages(make: SimpleNamespace) -> None:
    esf = b"".join(
        epoch(measurement(), tow_s=TOW_S + k)
        + b"".join(
            make.esf_meas(1000 * k + 100 * j + 50, [(16, 1024), (17, 0), (18, 10042)]) for j in range(10)
        )
        for k in range(20)
    )
    log = read_log(esf)
    start_s = 315_964_800 + WEEK * WEEK_S + TOW_S - 17
    assert len(log.force) == 200 and log.force.time_s[0] == pytest.approx(start_s + 0.05, abs=0.06)


def test_leap_seconds_are_the_receivers_where_it_knows_them() -> None:
    records = np.zeros(2, ubx_raw.TYPES[ubx_raw.RAWX][1])
    records["rcvTow"], records["week"], records["leapS"], records["recStat"] = TOW_S, WEEK, 19, [1, 0]
    utc_s = 315_964_800 + WEEK * WEEK_S + TOW_S
    assert ubx_raw.utc_of(records).tolist() == [utc_s - 19, utc_s - 17]


@settings(max_examples=60, deadline=None)
@given(st.binary(min_size=0, max_size=200))
@example(b"RINEX VERSION / TYPE")
@example(b"CRINEX VERS   / TYPE")
def test_any_bytes_are_read_or_counted(payload: bytes) -> None:
    log = read_log(epoch(measurement(satellite=7)) + frame(2, 0x15, payload))
    assert 7 in signals(log).number
