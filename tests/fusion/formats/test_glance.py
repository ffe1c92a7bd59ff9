"""What the ends of a file tell is what reading all of it tells, for every format."""

from __future__ import annotations

import contextlib
import subprocess
import sys
from pathlib import Path

import hatanaka
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fusion.errors import EmptyLogError, LogError, UnknownFormatError
from fusion.formats import FORMATS, glance_at, read_log
from fusion.formats.fit.walk import walk
from fusion.formats.glance import HEAD_BYTES, Ends, Glance
from fusion.formats.grouping import grouped
from fusion.simulate.write import rinex_file
from garmin_files import drive_fit, gpx, tcx, track
from gnss_tables import some_navigation, some_signals
from log_samples import (
    SAMPLES,
    Samples,
    csv,
    drive_gnsslogger,
    drive_nmea,
    drive_ubx,
    pseudoranges_csv,
    rtklib_pos,
    sensor_logger,
    torque,
)

EPOCHS = 400
LEAP_S = 20.0
LONG = Samples(
    SAMPLES
    | {
        "csv": csv(EPOCHS),
        "fit": drive_fit(EPOCHS),
        "gnsslogger": drive_gnsslogger(EPOCHS),
        "gpx": gpx(EPOCHS),
        "nmea": drive_nmea(EPOCHS),
        "pseudoranges-csv": pseudoranges_csv(some_signals(1, 60)),
        "rinex": rinex_file.observations(some_signals(1, 60)).encode(),
        "rtklib-pos": rtklib_pos(EPOCHS),
        "sensor-logger": sensor_logger(EPOCHS),
        "tcx": tcx([[track(0, 100), track(200, 100)]]),
        "torque": torque(EPOCHS),
        "ubx": drive_ubx(EPOCHS),
    }
)


def agree(glance: Glance, whole: Glance, within_s: float) -> bool:
    """Whether both say the same."""
    times = [glance.first_s, glance.last_s], [whole.first_s, whole.last_s]
    holds = [(g.has_positions, g.has_signals, g.has_navigation) for g in (glance, whole)]
    return holds[0] == holds[1] and np.allclose(*times, rtol=0, atol=within_s, equal_nan=True)


@pytest.mark.parametrize("name", list(FORMATS))
@pytest.mark.parametrize("share", [1.0, 0.3, 0.15])
def test_the_ends_tell_what_the_whole_file_does(name: str, share: float) -> None:
    data = LONG[name]
    glance = glance_at(Ends.of(data, int(share * len(data))), f"{name}.log")
    assert agree(glance, Glance.of(read_log(data)), LEAP_S if name == "rinex" else 1e-3)
    assert glance.source_format == name


def test_of_a_long_file_the_ends_alone_are_looked_at() -> None:
    rows = b"".join(b"%d,%.5f,8.4\n" % (1_600_000_000 + k, 49 + k * 1e-7) for k in range(400_000))
    data = b"time_s,lat_deg,lon_deg\n" + rows
    assert len(data) > 2 * HEAD_BYTES
    ends = Ends.of(data)
    assert len(ends.start) + len(ends.end) < 1 << 18
    glance = glance_at(ends)
    assert (glance.first_s, glance.last_s) == (1_600_000_000, 1_600_399_999)
    assert len(glance.track) < 10_000


def test_a_walk_through_a_fit_file_goes_on_at_the_same_pace_where_it_is_not_held() -> None:
    data = drive_fit(1000)
    ends = Ends(data[: len(data) // 2], data[-100:], len(data))
    glance = FORMATS["fit"].glance(ends)
    whole = Glance.of(read_log(data))
    assert glance.first_s == whole.first_s
    assert glance.last_s == pytest.approx(whole.last_s, abs=20)
    assert len(walk(data)[0]) == 1000
    assert len(walk(data[:40])[0]) == len(walk(b"")[0]) == 0


def test_no_file_takes_longer_for_what_is_in_it() -> None:
    """Empty messages and tags without end are passed over after some."""
    head = drive_fit(3)[:12]
    empty = head[:4] + (1 << 22).to_bytes(4, "little") + head[8:]
    assert walk(empty.ljust(head[0], b"\0") + bytes((0x40, 0, 0, 20, 0, 0)) + bytes(1 << 20))[1] < 300_000
    points = b"".join(
        b"<trkpt lat='49.%05d' lon='8'><time>%sZ</time></trkpt>" % (k, _clock(k)) for k in range(2000)
    )
    long = b"<gpx>" + b"<wpt/>" * 100_000 + b"<trk><trkseg>" + points + b"</trkseg></trk></gpx>"
    ends = Ends.of(long)
    assert len(FORMATS["gpx"].excerpt(ends)) <= 2 * ends.excerpt_bytes + 5
    assert agree(glance_at(ends), Glance.of(read_log(long)), 1e-3)


def _clock(second: int) -> bytes:
    return b"2026-05-01T10:%02d:%02d" % divmod(second, 60)


@pytest.mark.parametrize("name", list(FORMATS))
@settings(max_examples=30, deadline=None)
@given(
    damage=st.lists(
        st.tuples(st.integers(0, 59_999), st.integers(0, 40), st.binary(max_size=6)), min_size=1, max_size=8
    ),
    share=st.sampled_from([0.1, 0.3, 1.0]),
)
def test_damaged_a_file_tells_something_or_raises_a_log_error(
    name: str, damage: list[tuple[int, int, bytes]], share: float
) -> None:
    data = bytearray(LONG[name][:60_000])
    for place, gone, put in damage:
        at = place % len(data)
        data[at : at + gone] = put
    with contextlib.suppress(LogError):
        glance = glance_at(Ends.of(bytes(data), int(share * len(data))))
        assert grouped([glance, glance]).drives


def test_navigation_and_compact_observations_are_told_by_their_lines() -> None:
    signals, data = some_signals(1, 20, 1.38e9), some_navigation(2, 60, 1.38e9)
    navigation = glance_at(Ends.of(rinex_file.navigation(data).encode()))
    assert (navigation.has_navigation, navigation.makes_a_drive) == (True, False)
    assert 1.695e9 < navigation.first_s < navigation.last_s < 1.697e9
    compact = glance_at(Ends.of(hatanaka.rnx2crx(rinex_file.observations(signals).encode())))
    assert compact.has_signals
    assert compact.first_s == pytest.approx(signals.time_s[0], abs=LEAP_S)


def test_no_compiled_code_is_loaded_for_a_glance() -> None:
    code = (
        "import sys\nfrom fusion.formats import glance_at\nfrom fusion.formats.glance import Ends\n"
        "glance_at(Ends.of(sys.stdin.buffer.read()))\nprint('numba' in sys.modules)"
    )
    told = subprocess.run([sys.executable, "-c", code], input=LONG["rinex"], capture_output=True, check=True)
    assert told.stdout == b"False\n"


def test_what_is_no_log_is_refused_and_of_a_long_broken_one_nothing_is_known() -> None:
    with pytest.raises(UnknownFormatError):
        glance_at(Ends.of(b"hello there"))
    empty = b"time_s,lat_deg,lon_deg\n" + b"1600000000,,\n" * 20
    with pytest.raises(EmptyLogError):
        read_log(empty)
    assert not glance_at(Ends.of(empty)).makes_a_drive
    with pytest.raises(EmptyLogError, match="no track"):
        glance_at(Ends.of(b"<gpx><wpt lat='1' lon='2'/></gpx>"))
    long = b"<gpx>" + b"<wpt lat='1' lon='2'/>" * 20_000 + b"</gpx>"
    assert glance_at(Ends.of(long)).is_unread


def test_times_before_a_receiver_knows_the_date_and_logs_without_any_do_not_count() -> None:
    rows = b"".join(b"%d,%.5f,8.4\n" % (1_600_000_000 + k, 49 + k * 1e-5) for k in range(40))
    glance = glance_at(Ends.of(b"time_s,lat_deg,lon_deg\n400000000,49,8.4\n" + rows))
    assert glance.first_s == 1_600_000_000
    undated = b"\n".join(line for line in LONG["nmea"].splitlines() if b"GGA" in line)
    assert glance_at(Ends.of(undated)).has_positions
    assert not glance_at(Ends.of(undated)).is_known


@pytest.mark.parametrize(
    "name", ["2019-02-17-062644-ELEMNT-297E-195-0.fit", "gnsslogger_pixel6.txt", "pixel6.nmea"]
)
def test_recordings_of_others(shared_data: Path, name: str) -> None:
    data = (shared_data / "formats" / name).read_bytes()
    assert agree(glance_at(Ends.of(data), name), Glance.of(read_log(data)), 1.0)
