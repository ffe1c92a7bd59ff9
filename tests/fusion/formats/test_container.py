"""What a file is before it is a log: gzip once and twice, whole, truncated and damaged; bombs; foreign files."""

from __future__ import annotations

import gzip
import io
from pathlib import Path

import numpy as np
import pytest

from fusion.errors import MalformedLogError, UnknownFormatError
from fusion.formats import FORMATS, read_log
from fusion.formats.base import Notes
from fusion.formats.container import gunzip
from log_support import same


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


@pytest.mark.parametrize(
    ("blob", "says"),
    [
        (b"", "empty"),
        (b"\x89PNG\r\n\x1a\n" + bytes(50), "PNG"),
        (b"PK\x03\x04" + bytes(50), "ZIP"),
        (b"%PDF-1.7\n%\xe2\xe3", "PDF"),
        (b"\x1f\x9d\x90" + bytes(50), "compress"),
        (b"#cP2023  3 14  0  0  0.00000000     288 d+D   IGS14 FIT AIUB\n", "SP3"),
        (b'{"type": "FeatureCollection", "features": []}', "JSON"),
        (b'<?xml version="1.0"?><kml xmlns="x"><Document/></kml>', "KML"),
        (b"<!DOCTYPE html><html><body>no</body></html>", "HTML"),
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


def test_a_small_file_takes_little_memory_however_large_one_may_be(
    samples: dict[str, bytes], tmp_path: Path
) -> None:
    path = tmp_path / "log"
    path.write_bytes(samples["csv"])
    with path.open("rb") as stream:
        for source in (path, stream):
            assert len(read_log(source, max_bytes=2**50).fix) == 20


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
