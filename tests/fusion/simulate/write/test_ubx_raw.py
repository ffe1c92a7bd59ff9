"""Raw messages beside the others of a drive: what is written is what is read, in the order of sending."""

from __future__ import annotations

import io
from dataclasses import replace

import numpy as np
import pytest
from pyubx2 import ERR_RAISE, VALCKSUM, UBXReader

from fusion.formats import read_log
from fusion.signals import Navigation, RawGnss, Signals, gps_from_unix
from fusion.simulate.drive import simulate_drive
from fusion.simulate.scene.town import Town
from fusion.simulate.write.ubx_file import in_order, raw_messages, ubx_bytes
from raw_support import random_navigation, signals_of


def test_signals_come_back_as_a_receiver_states_them() -> None:
    navigation = random_navigation(6)
    sent = signals_of(navigation, 6, 40)
    uneven = sent.take_rows(np.random.default_rng(1).random(len(sent.system)) < 0.6)
    log = read_log(in_order(raw_messages(RawGnss(uneven, navigation))))
    assert log.raw is not None
    found = log.raw.signals
    for name in (
        "gps_s",
        "first",
        "system",
        "number",
        "pseudorange_m",
        "cn0_dbhz",
        "sigma_m",
        "frequency_hz",
    ):
        assert getattr(found, name).tolist() == getattr(uneven, name).tolist(), name
    assert found.range_rate_mps == pytest.approx(uneven.range_rate_mps, abs=1e-4)  # Doppler in 32 bits
    assert np.isnan(found.position_m).all()


def test_what_a_receiver_rounds_is_rounded() -> None:
    navigation = random_navigation(6)
    sent = signals_of(navigation, 6, 2)
    rough = replace(sent, cn0_dbhz=sent.cn0_dbhz + 0.3, sigma_m=sent.sigma_m * 1.3)
    log = read_log(in_order(raw_messages(RawGnss(rough, Navigation()))))
    assert log.raw is not None
    assert log.raw.signals.cn0_dbhz.tolist() == sent.cn0_dbhz.tolist()
    assert log.raw.signals.sigma_m.tolist() == sent.sigma_m.tolist()


def test_signals_that_bring_their_satellites_are_refused() -> None:
    sent = signals_of(random_navigation(6), 6, 2)
    placed = replace(sent, position_m=np.ones((len(sent.system), 3)))
    with pytest.raises(ValueError, match="nothing that a receiver writes"):
        raw_messages(RawGnss(placed, Navigation()))


def test_no_signals_make_no_messages() -> None:
    assert raw_messages(RawGnss(Signals.empty(), random_navigation(1))) == []
    assert in_order([]) == b""


def test_a_simulated_drive_carries_everything(town: Town) -> None:
    drive = simulate_drive(town, 21, 60.0)
    start_s = float(gps_from_unix(drive.time_s[:1])[0])
    navigation = random_navigation(7, start_s)
    raw = RawGnss(signals_of(navigation, 7, 60, start_s), navigation)
    sample = ubx_bytes(drive, raw)
    messages = [m for _, m in UBXReader(io.BytesIO(sample), validate=VALCKSUM, quitonerror=ERR_RAISE)]
    kinds = [m.identity for m in messages]
    assert set(kinds) == {"NAV-PVT", "NAV-ATT", "NAV-EOE", "ESF-MEAS", "RXM-RAWX", "RXM-SFRBX"}
    epochs = [k for k in kinds if k in ("NAV-PVT", "RXM-RAWX")]
    assert epochs[:4] == ["RXM-RAWX", "NAV-PVT"] * 2
    words = [m for m in messages if m.identity == "RXM-SFRBX" and m.gnssId == 0]
    assert all(m.numWords == 10 and m.dwrd_01 >> 22 == 0x8B for m in words)
    log, plain = read_log(sample), read_log(ubx_bytes(drive))
    assert log.raw is not None and plain.raw is None
    assert len(log.raw.navigation) == len(navigation)
    assert np.array_equal(log.fix.time_s, plain.fix.time_s)
    assert log.force.time_s == pytest.approx(plain.force.time_s, abs=1e-9)
    assert not log.skipped and not log.warnings
