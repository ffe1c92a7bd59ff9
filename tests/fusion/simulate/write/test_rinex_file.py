"""What is written as RINEX is read as it was."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fusion.formats.rinex.log import RinexFormat
from fusion.signals import Navigation, RawGnss, Signals
from fusion.simulate.write import rinex_file
from fusion.types import no_progress
from gnss_tables import agree, some_navigation, some_signals

SEEDS = st.integers(0, 2**32 - 1)


def read(text: str) -> RawGnss:
    """What the reader makes of it; it has nothing to complain of."""
    log = RinexFormat().read_part(text.encode(), no_progress, Navigation())
    assert not log.skipped
    assert not log.repaired
    assert not log.warnings
    assert log.raw is not None
    return log.raw


@settings(max_examples=30, deadline=None)
@given(SEEDS, st.floats(0, 2e9).map(lambda t: round(t, 3)))
def test_observations_come_back_as_they_are_written(seed: int, began_s: float) -> None:
    signals = some_signals(seed, began_s=began_s)
    back = read(rinex_file.observations(signals)).signals
    # to a thousandth of a hertz, and a tenth of a microsecond
    assert agree(signals, back, range_rate_mps=2e-4, gps_s=5e-7)


@settings(max_examples=30, deadline=None)
@given(SEEDS, st.floats(2e7, 2e9))
def test_ephemerides_come_back_as_they_are_written(seed: int, near_s: float) -> None:
    data = some_navigation(seed, near_s=near_s)
    back = read(rinex_file.navigation(data)).navigation
    assert agree(data.kepler, back.kepler)
    assert agree(data.glonass, back.glonass)
    assert back.klobuchar == pytest.approx(data.klobuchar)


def test_nothing_is_written_as_headers_alone() -> None:
    assert rinex_file.observations(Signals.empty()).splitlines()[-1].strip() == "END OF HEADER"
    assert rinex_file.navigation(Navigation()).splitlines()[-1].strip() == "END OF HEADER"


def test_what_is_unknown_is_left_blank() -> None:
    one = Signals.assemble(np.array([1e9]), np.array([0]), np.array([7]), pseudorange_m=np.array([2e7]))
    assert rinex_file.observations(one).splitlines()[-1] == "G07  20000000.000"
    assert np.isnan(read(rinex_file.observations(one)).signals.cn0_dbhz).all()
