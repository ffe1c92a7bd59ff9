"""The contract that every log format keeps, whatever it is."""

from __future__ import annotations

import contextlib
import gzip
import io
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from fusion.errors import EmptyLogError, LogError, MalformedLogError, UnknownFormatError
from fusion.formats import FORMATS, read_log
from fusion.formats.base import Notes
from fusion.formats.container import gunzip
from fusion.types import DriveLog, no_progress

FUZZ = settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


def same(a: DriveLog, b: DriveLog) -> bool:
    return all(
        np.array_equal(getattr(x, c), getattr(b.tables()[name], c), equal_nan=True)
        for name, x in a.tables().items()
        for c in ("time_s", *x.columns())
    )


def test_every_format_has_a_sample_and_a_matching_name(samples: dict[str, bytes]) -> None:
    assert set(samples) == set(FORMATS)
    assert all(name == f.name and f.description and f.suffixes for name, f in FORMATS.items())


@pytest.mark.parametrize("name", list(FORMATS))
def test_recognises_its_own_sample_and_no_other(samples: dict[str, bytes], name: str) -> None:
    assert [n for n, sample in samples.items() if FORMATS[name].recognises(sample)] == [name]


@pytest.mark.parametrize("name", list(FORMATS))
def test_reads_its_sample_into_a_sound_log(samples: dict[str, bytes], name: str) -> None:
    log = read_log(samples[name])
    assert log.source_format == name
    assert len(log.fix) >= 1
    west, south, east, north = log.bounds_deg()
    assert (1.8 < west <= east < 1.9) and (50.9 < south <= north < 51)
    assert not log.missing or all(isinstance(m, str) for m in log.missing)


@pytest.mark.parametrize("name", list(FORMATS))
def test_gzipped_once_or_twice_in_members_or_streamed_equals_plain(
    samples: dict[str, bytes], name: str, tmp_path: Path
) -> None:
    plain, sample = read_log(samples[name]), samples[name]
    half = len(sample) // 2
    members = gzip.compress(sample[:half]) + gzip.compress(sample[half:])
    path = tmp_path / "log.bin"
    path.write_bytes(sample)
    for source in (
        gzip.compress(sample),
        gzip.compress(gzip.compress(sample)),
        members,
        path,
        io.BytesIO(sample),
    ):
        assert same(read_log(source), plain)


@pytest.mark.parametrize("name", list(FORMATS))
def test_truncated_anywhere_it_reads_or_raises_a_log_error(samples: dict[str, bytes], name: str) -> None:
    sample = samples[name]
    for cut in np.unique(np.linspace(0, len(sample) - 1, 120).astype(int)):
        try:
            log = read_log(sample[:cut])
        except LogError as error:
            assert str(error).rstrip().endswith(".")
        else:
            assert len(log.fix) >= 1


@pytest.mark.parametrize("name", list(FORMATS))
@FUZZ
@given(data=st.data())
def test_damaged_it_reads_or_raises_a_log_error(
    samples: dict[str, bytes], name: str, data: st.DataObject
) -> None:
    sample = bytearray(samples[name][:6000])
    for _ in range(data.draw(st.integers(1, 20))):
        at = data.draw(st.integers(0, len(sample) - 1))
        sample[at : at + data.draw(st.integers(0, 4))] = data.draw(st.binary(max_size=6))
    for reader in (read_log, lambda b: FORMATS[name].read(b, no_progress)):
        with contextlib.suppress(LogError):
            assert len(reader(bytes(sample)).fix) >= 1


@FUZZ
@given(st.one_of(st.binary(max_size=3000), st.text(max_size=500).map(str.encode)))
def test_random_bytes_raise_nothing_but_log_errors(blob: bytes) -> None:
    for lead in (
        b"",
        b"\x1f\x8b",
        b"\xb5\x62",
        b"$GNRMC,",
        b"<gpx>",
        b"time_s,lat_deg,lon_deg\n",
        b"\xff\xfe",
    ):
        with pytest.raises(LogError):
            read_log(lead + blob)


@pytest.mark.parametrize(
    ("blob", "says"),
    [
        (b"", "empty"),
        (b"\x89PNG\r\n\x1a\n" + bytes(50), "PNG"),
        (b"PK\x03\x04" + bytes(50), "ZIP"),
        (b"%PDF-1.7\n%\xe2\xe3", "PDF"),
        (b'{"type": "FeatureCollection", "features": []}', "JSON"),
        (b'<?xml version="1.0"?><kml xmlns="x"><Document/></kml>', "KML"),
        (b"<!DOCTYPE html><html><body>no</body></html>", "HTML"),
        (b"\x0e\x10\x43\x08\x00\x00\x00\x00.FIT" + bytes(50), "FIT"),
        (bytes(range(14, 32)) * 10, "no format"),
    ],
)
def test_foreign_files_are_named_and_the_formats_listed(blob: bytes, says: str) -> None:
    with pytest.raises(UnknownFormatError, match=says) as caught:
        read_log(blob)
    assert all(f.description in str(caught.value) for _, f in FORMATS.items())


@pytest.mark.slow
def test_a_zip_bomb_is_refused_after_a_small_part_of_it() -> None:
    bomb = gzip.compress(bytes(200 << 20), 9)
    seen: list[float] = []
    with pytest.raises(MalformedLogError, match="zip bomb"):
        gunzip(bomb, 2**31, Notes(), lambda stage, share: seen.append(share))
    with pytest.raises(MalformedLogError, match="zip bomb"):
        read_log(bomb)
    with pytest.raises(MalformedLogError, match="zip bomb"):
        read_log(gzip.compress(gzip.compress(bytes(80 << 20))))
    with pytest.raises(MalformedLogError, match="more than twice"):
        read_log(gzip.compress(gzip.compress(gzip.compress(b"time_s"))))


def test_the_size_limit_holds_for_plain_and_packed_logs(samples: dict[str, bytes], tmp_path: Path) -> None:
    sample = samples["csv"]
    path = tmp_path / "log.csv"
    path.write_bytes(sample)
    assert len(read_log(path, max_bytes=len(sample)).fix) == 20
    for source in (sample, path, io.BytesIO(sample), gzip.compress(sample)):
        with pytest.raises(MalformedLogError):
            read_log(source, max_bytes=len(sample) - 1)


def test_a_truncated_gzip_gives_what_could_be_unpacked(samples: dict[str, bytes]) -> None:
    packed = gzip.compress(samples["nmea"])
    log = read_log(packed[: len(packed) * 2 // 3])
    assert 1 <= len(log.fix) < 20
    assert any("gzip" in w for w in log.warnings)
    assert sum(log.repaired.values()) >= 1


def test_a_wrong_gzip_checksum_is_a_warning_and_all_data_is_used(samples: dict[str, bytes]) -> None:
    packed = bytearray(gzip.compress(samples["csv"]))
    for at in (-8, -1):  # of the checksum, of the length
        wrong = packed.copy()
        wrong[at] ^= 0x55
        log = read_log(bytes(wrong))
        assert same(log, read_log(samples["csv"]))
        assert any("checksum does not match" in w for w in log.warnings)


def test_damage_within_a_gzip_costs_only_what_comes_after() -> None:
    rng = np.random.default_rng(5)
    rows = "".join(f"{1525448060 + k},49.{rng.integers(10**9)},8\n" for k in range(5000))
    packed = bytearray(gzip.compress(b"time_s,lat_deg,lon_deg\n" + rows.encode()))
    half = len(packed) // 2
    packed[half : half + 2000] = b"\xff" * 2000
    log = read_log(bytes(packed))
    assert 1500 < len(log.fix) < 5000
    assert any("damaged" in w for w in log.warnings)


@pytest.mark.parametrize("kept", [2, 10, 14])
def test_the_beginning_of_a_gzip_alone_is_called_that(samples: dict[str, bytes], kept: int) -> None:
    with pytest.raises(MalformedLogError, match="beginning of a gzip and nothing else"):
        read_log(gzip.compress(samples["csv"])[:kept])
    with pytest.raises(UnknownFormatError, match="empty"):
        read_log(gzip.compress(b""))


def test_an_absurd_time_is_named_in_few_digits() -> None:
    with pytest.raises(EmptyLogError, match=r"the time is 1e\+300 s, outside") as caught:
        read_log(b"time_s,lat_deg,lon_deg\n1e300,49,8\n")
    assert len(str(caught.value)) < 300


@pytest.mark.parametrize("order", [slice(None), slice(None, None, -1)])
def test_disorder_of_the_positions_is_said(samples: dict[str, bytes], order: slice) -> None:
    header, *rows = samples["csv"].splitlines()
    log = read_log(b"\n".join([header, *rows[order]]))
    assert same(log, read_log(samples["csv"]))
    said = [w for w in log.warnings if "sorted by time" in w]
    assert said == (
        []
        if order.step is None
        else [f"{len(rows) - 1} of the positions stand before an earlier one: they were sorted by time."]
    )


def test_a_missing_file_is_a_log_error_and_progress_may_abort(
    samples: dict[str, bytes], tmp_path: Path
) -> None:
    with pytest.raises(LogError, match="cannot be read"):
        read_log(tmp_path / "none.csv")

    def stop(stage: str, share: float) -> None:
        raise KeyboardInterrupt

    for sample in samples.values():
        with pytest.raises(KeyboardInterrupt):
            read_log(sample, progress=stop)


def test_the_shared_comma2k19_log_reads(shared_data: Path) -> None:
    log = read_log(shared_data / "comma2k19" / "log.csv")
    assert (len(log.fix), len(log.force), len(log.rate), len(log.odometry)) == (579, 579, 579, 579)
    assert not log.skipped and not log.warnings
    assert np.nanmean(log.force.acc_z_mps2) == pytest.approx(9.8, abs=0.3)
    assert np.hypot(log.velocity.vel_n_mps[0], log.velocity.vel_e_mps[0]) == pytest.approx(7.823)
    assert log.fix.has("height_ell_m") and not log.fix.has("alt_msl_m")


def test_empty_logs_say_what_was_wrong() -> None:
    with pytest.raises(EmptyLogError, match=r"line 2: lat_deg is 91"):
        read_log(b"time_s,lat_deg,lon_deg\n1525448060,91,8\n")
