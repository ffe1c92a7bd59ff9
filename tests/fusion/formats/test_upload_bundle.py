"""Several files of one drive: one log of them all, in any order and packing; what does not fit is said."""

from __future__ import annotations

import gzip
import io
import zipfile
from pathlib import Path
from types import SimpleNamespace

import hatanaka
import numpy as np
import pytest

from fusion.errors import EmptyLogError, LogError, MalformedLogError, UnknownFormatError
from fusion.formats import read_log, read_logs
from fusion.signals import GLONASS, RawGnss, Signals
from fusion.simulate.write import rinex_file
from fusion.types import DriveLog
from gnss_tables import agree, some_navigation, some_signals
from log_support import same

BEGAN_S = 1.38e9
SIGNALS = some_signals(1, 30, BEGAN_S)
DATA = some_navigation(2, 60, BEGAN_S)
OBSERVATIONS = rinex_file.observations(SIGNALS).encode()
NAVIGATION = rinex_file.navigation(DATA).encode()


def packed(**files: bytes) -> bytes:
    """A zip of files."""
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as made:
        for name, data in files.items():
            made.writestr(name, data)
    return out.getvalue()


def raw_of(log: DriveLog) -> RawGnss:
    """Its raw side."""
    assert log.raw is not None
    return log.raw


def sensors(count: int = 30, began_s: float = 0.0) -> bytes:
    """A Versant CSV of an odometer and a gyroscope, beside the signals."""
    start = SIGNALS.time_s[0] + began_s
    rows = "".join(f"{start + k},7.5,0.1\n" for k in range(count))
    return f"time_s,odo_speed_mps,gyr_z_dps\n{rows}".encode()


def test_observations_and_navigation_in_any_order_and_packing(tmp_path: Path) -> None:
    plain, gz = tmp_path / "a.rnx", tmp_path / "b.rnx.gz"
    plain.write_bytes(OBSERVATIONS)
    gz.write_bytes(gzip.compress(NAVIGATION))
    ways = [
        read_logs([OBSERVATIONS, NAVIGATION]),
        read_logs([NAVIGATION, OBSERVATIONS]),
        read_logs([gz, plain]),
        read_logs([io.BytesIO(OBSERVATIONS), gz]),
        read_log(packed(obs=OBSERVATIONS, nav=NAVIGATION)),
        read_log(packed(nav=gzip.compress(NAVIGATION), obs=hatanaka.rnx2crx(OBSERVATIONS))),
        read_log(gzip.compress(packed(obs=OBSERVATIONS, nav=NAVIGATION))),
        read_logs([packed(obs=OBSERVATIONS), packed(nav=NAVIGATION)]),
    ]
    for log in ways:
        assert agree(raw_of(log).signals, SIGNALS, range_rate_mps=2e-4, gps_s=5e-7)
        assert agree(raw_of(log).navigation.kepler, DATA.kepler)
        assert agree(raw_of(log).navigation.glonass, DATA.glonass)
        assert log.source_format == "rinex"
        assert not log.warnings


def test_glonass_channels_are_those_of_the_navigation_file() -> None:
    without = "\n".join(
        line for line in OBSERVATIONS.decode().splitlines() if "GLONASS SLOT" not in line
    ).encode()
    alone, beside = raw_of(read_log(without)).signals, raw_of(read_logs([without, NAVIGATION])).signals
    assert np.isnan(alone.frequency_hz[alone.system == GLONASS]).all()
    assert agree(beside, SIGNALS, range_rate_mps=2e-4, gps_s=5e-7)


def test_a_csv_of_sensors_joins_raw_measurements_and_is_refused_alone() -> None:
    log = read_logs([OBSERVATIONS, NAVIGATION, sensors()])
    assert (len(log.odometry), len(log.rate), len(log.fix)) == (30, 30, 0)
    assert log.source_format == "rinex+csv"
    with pytest.raises(MalformedLogError, match="lacks required columns: lat_deg, lon_deg"):
        read_log(sensors())
    blank = b"time_s,lat_deg,lon_deg,odo_speed_mps\n%d,,,5\n" % int(SIGNALS.time_s[0])
    assert len(read_logs([OBSERVATIONS, blank]).odometry) == 1
    with pytest.raises(EmptyLogError, match="no usable position"):
        read_log(blank)
    with pytest.raises(EmptyLogError, match="no usable position, nor raw measurements"):
        read_logs([sensors(), blank])


def test_tables_follow_each_other_or_the_fuller_is_used() -> None:
    log = read_logs([OBSERVATIONS, sensors(10, 20.0), sensors(15)])
    assert len(log.odometry) == 25
    assert np.all(np.diff(log.odometry.time_s) > 0)
    log = read_logs([OBSERVATIONS, sensors(10, 5.0), sensors(15)])
    assert len(log.odometry) == 15
    assert any("the 15 of file 3 are used, the 10 of file 2 are not" in w for w in log.warnings)
    log = read_logs([OBSERVATIONS, sensors(10, 5.0), sensors(15)], names=["a", "dir/b.csv"])
    assert any("the 15 of file 3 are used, the 10 of b.csv are not" in w for w in log.warnings)


def test_signals_follow_each_other_or_the_fuller_are_used() -> None:
    first, second = SIGNALS.take_rows(SIGNALS.epoch < 12), SIGNALS.take_rows(SIGNALS.epoch >= 12)
    halves = [rinex_file.observations(s).encode() for s in (second, first)]
    assert agree(raw_of(read_logs([*halves, NAVIGATION])).signals, SIGNALS, range_rate_mps=2e-4, gps_s=5e-7)
    log = read_logs([OBSERVATIONS, halves[0], NAVIGATION])
    assert len(raw_of(log).signals) == 30
    assert any("raw measurements for the same times" in w for w in log.warnings)


def test_one_file_in_a_zip_is_that_file(samples: dict[str, bytes]) -> None:
    for name, sample in samples.items():
        for log in (read_log(packed(a=sample)), read_logs([sample])):
            assert same(log, read_log(sample))
            assert log.source_format == name


def test_positions_and_raw_measurements_of_one_drive(samples: dict[str, bytes]) -> None:
    log = read_logs([samples["gpx"], samples["rinex"]])
    assert len(log.fix) > 0
    assert len(raw_of(log).signals) > 0


def test_navigation_alone_belongs_to_observations() -> None:
    for source in ([NAVIGATION, NAVIGATION], [packed(a=NAVIGATION)], [NAVIGATION]):
        with pytest.raises(EmptyLogError, match=r"belongs? to a file of observations"):
            read_logs(source)


def test_other_files_are_left_out_by_name_and_broken_ones_with_their_reason() -> None:
    data = {"readme.txt": b"hello there", "obs.rnx": OBSERVATIONS, "nav.rnx": NAVIGATION}
    half = NAVIGATION[:200]
    log = read_log(packed(**data, broken=half))
    assert agree(raw_of(log).signals, SIGNALS, range_rate_mps=2e-4, gps_s=5e-7)
    assert log.skipped["files that are no logs"] == 1
    assert any("readme.txt" in w for w in log.warnings)
    assert any(
        w.startswith("broken was left out. The header of this RINEX file has no end") for w in log.warnings
    )
    with pytest.raises(UnknownFormatError):
        read_log(packed(a=b"hello there", b=b"you too"))
    with pytest.raises(MalformedLogError, match="has no end"):
        read_log(packed(a=half, b=b"hello there"))
    with pytest.raises(MalformedLogError, match="has no end"):
        read_logs([NAVIGATION, OBSERVATIONS[:200]])
    with pytest.raises(LogError, match="No file"):
        read_logs([])


def test_bytes_are_counted_over_all_files() -> None:
    both = len(OBSERVATIONS) + len(NAVIGATION)
    assert read_logs([OBSERVATIONS, NAVIGATION], max_bytes=both).raw is not None
    with pytest.raises(MalformedLogError, match="larger than"):
        read_logs([OBSERVATIONS, NAVIGATION], max_bytes=both - 1)
    with pytest.raises(MalformedLogError):
        read_log(packed(a=gzip.compress(OBSERVATIONS), b=gzip.compress(NAVIGATION)), max_bytes=both - 1)


def test_a_phones_text_with_the_navigation_file_of_another_day(
    shared_data: Path, make: SimpleNamespace
) -> None:
    folder = shared_data
    log = read_logs(
        [
            folder / "formats" / "gnsslogger_pixel6.txt",
            folder / "gnss" / "BRDC00WRD_S_20230730000_01D_MN.rnx",
        ]
    )
    assert len(log.fix) == 94
    assert len(raw_of(log).navigation) > 0
    text = make.gnsslogger([make.raw_line("G", 3, 10**12, 7 * 10**7)])
    assert isinstance(raw_of(read_logs([text, NAVIGATION])).signals, Signals)


def test_an_empty_log_is_not_made_of_a_text_without_measurements(make: SimpleNamespace) -> None:
    assert len(read_logs([OBSERVATIONS, make.gnsslogger(["Accel,1,2,3"])]).fix) == 0
