"""Logs of more positions than any drive has: one rule for all formats, and not read to their end."""

from __future__ import annotations

import pytest

from fusion.errors import MalformedLogError
from fusion.formats import base, read_log, read_logs, xml_points

HEAD = b"time_s,lat_deg,lon_deg\n"


def rows(count: int, first: int = 0) -> bytes:
    return b"".join(b"%d,49.%05d,8.4\n" % (1_700_000_000 + first + k, k) for k in range(count))


def points(count: int) -> bytes:
    point = b'<trkpt lat="49.%05d" lon="8.4"><time>2024-01-01T%02d:%02d:%02dZ</time></trkpt>'
    body = b"".join(point % (k, k // 3600, k // 60 % 60, k % 60) for k in range(count))
    return b'<gpx version="1.1"><trk><trkseg>' + body + b"</trkseg></trk></gpx>"


def sentences(count: int) -> bytes:
    out = []
    for k in range(count):
        text = b"GPRMC,%02d%02d%02d.00,A,4900.%05d,N,00824.00000,E,10.0,0.0,010124,,,A"
        body = text % (k // 3600, k // 60 % 60, k % 60, k)
        check = 0
        for byte in body:
            check ^= byte
        out.append(b"$%s*%02X\r\n" % (body, check))
    return b"".join(out)


@pytest.mark.parametrize(
    "content", [HEAD + rows(101), points(101), sentences(101)], ids=["csv", "gpx", "nmea"]
)
def test_too_many_positions_are_refused_with_what_to_do(
    content: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(base, "MAX_POSITIONS", 101)
    assert len(read_log(content).fix) == 101
    monkeypatch.setattr(base, "MAX_POSITIONS", 100)
    with pytest.raises(MalformedLogError, match=r"more than 100 positions.* Split the recording"):
        read_log(content)


def test_files_of_one_drive_are_counted_together(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(base, "MAX_POSITIONS", 100)
    with pytest.raises(MalformedLogError, match="more than 100 positions"):
        read_logs([HEAD + rows(60), HEAD + rows(60, first=1000)])


def test_three_million_rows_are_not_read_to_their_end(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(base, "MAX_POSITIONS", 500_000)
    share = 0.0

    def progress(stage: str, done: float) -> None:
        nonlocal share
        share = max(share, done if stage == "read rows" else 0.0)

    with pytest.raises(MalformedLogError, match="more than 500000 positions"):
        read_log(HEAD + rows(1_000) + rows(1_500_000, first=5_000), progress=progress)
    assert share < 0.8


def test_signals_of_satellites_have_a_bound_of_their_own(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(base, "MAX_SIGNALS", 100)
    base.refuse_many(101, 100)
    with pytest.raises(MalformedLogError, match=r"more than 100 signals of satellites.* Split the recording"):
        base.refuse_many(0, 101)


def test_times_are_read_in_portions_with_the_same_result(monkeypatch: pytest.MonkeyPatch) -> None:
    """One point has no time, one a time that is none: they are counted and named as in one go."""
    content = (
        points(60).replace(b"<time>2024-01-01T00:00:07Z</time>", b"").replace(b"T00:00:21Z", b"T25:00:21Z")
    )
    whole = read_log(content)
    monkeypatch.setattr(xml_points, "CHUNK_BYTES", 300)
    monkeypatch.setattr(xml_points, "TIMES_AT_ONCE", 5)
    again = read_log(content)
    assert again.fix.time_s.tolist() == whole.fix.time_s.tolist()
    assert len(again.fix) == 58
    assert (again.skipped, again.warnings) == (whole.skipped, whole.warnings)
    assert "T25:00:21Z" in str(whole.warnings)
