"""What is no log is refused while it comes; what may be one is not, however it is packed and cut into pieces."""

from __future__ import annotations

import gzip
import io
import zipfile
from typing import Any

from hypothesis import given, settings
from hypothesis import strategies as st
from sqlalchemy import text

from app.drives.receiving import first_look
from app.drives.receiving.first_look import FirstLook
from fusion import formats
from fusion.errors import LogError, MalformedLogError, UnknownFormatError

CSV = b"time_s,lat_deg,lon_deg\n1700000000,49,8.4\n"
SENSORS = b"time_s,pressure_hpa\n1700000000,1000\n"
NAV = f"{'     3.04           N: GNSS NAV DATA    M':60}RINEX VERSION / TYPE\n".encode()
PICTURE = b"\x89PNG\r\n\x1a\n" + bytes(range(256)) * 400
PROSE = b"Dear reader\nthis is no log.\n" * 20
FRAME = b"\xb5\x62\x0a\x04\x00\x00\x0e\x34"


def looked(*files: bytes, piece: int = 1 << 16, columns: dict[str, str] | None = None) -> LogError | None:
    """What is said of files that come in pieces."""
    look = FirstLook(columns)
    for file in files:
        look.begin()
        for at in range(0, len(file), piece):
            look.feed(file[at : at + piece])
    try:
        look.check()
    except LogError as error:
        return error
    return None


def test_as_much_is_looked_at_as_the_library_does() -> None:
    assert first_look.HEAD_BYTES == formats.HEAD_BYTES


@settings(max_examples=30, deadline=None)
@given(st.integers(1, 3000), st.integers(0, 2), st.booleans())
def test_packing_and_pieces_change_nothing(piece: int, layers: int, members: bool) -> None:
    for file, fault in ((CSV, None), (PICTURE, UnknownFormatError), (SENSORS, MalformedLogError)):
        packed = file
        for _ in range(layers):
            packed = (
                gzip.compress(packed[:30]) + gzip.compress(packed[30:]) if members else gzip.compress(packed)
            )
        said = looked(packed, piece=piece)
        assert said is None if fault is None else type(said) is fault


def test_one_log_among_files_is_enough_and_none_is_not() -> None:
    assert looked(PICTURE, CSV) is None
    assert looked(NAV) is None
    assert looked(SENSORS, NAV) is None
    assert isinstance(looked(PICTURE, PROSE), UnknownFormatError)
    assert "lat_deg" in str(looked(SENSORS))


def test_a_log_may_begin_late_but_not_after_what_is_looked_at() -> None:
    noise = bytes(range(1, 255)) * 1000
    assert looked(noise + FRAME) is None
    assert isinstance(looked(noise * 20 + FRAME), UnknownFormatError)


def test_a_damaged_gzip_is_judged_by_what_comes_before_the_damage() -> None:
    packed = bytearray(gzip.compress(CSV * 3000, 1))
    packed[len(packed) // 2] ^= 0xFF
    assert looked(bytes(packed)) is None
    assert looked(gzip.compress(CSV * 100)[:100]) is None
    said = looked(gzip.compress(CSV)[:6])
    assert isinstance(said, MalformedLogError)
    assert "beginning of a gzip" in str(said)
    thrice = gzip.compress(gzip.compress(gzip.compress(CSV)))
    assert "more than twice" in str(looked(thrice))


def test_columns_that_a_person_names_are_known() -> None:
    file = b"t;breite;laenge\n"
    assert isinstance(looked(file), MalformedLogError)
    named = {"time": "t", "lat_deg": "breite", "lon_deg": "laenge"}
    assert looked(file, columns=named) is None
    assert "names: t, breite, laenge" in str(looked(file, columns=named | {"alt_msl_m": "hoehe"}))


def test_little_is_held_of_much() -> None:
    look = FirstLook()
    look.begin()
    for _ in range(100):
        look.feed(PROSE * 2000)
    assert look._head is None
    look.begin()
    look.feed(CSV * 3000)
    assert look._head is None


def zipped(*files: bytes) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        for number, data in enumerate(files):
            archive.writestr(f"{number}.txt", data)
    return out.getvalue()


REFUSED: dict[str, tuple[dict[str, Any], int, str]] = {
    "picture": ({"content": PICTURE}, 415, "a PNG picture"),
    "prose": ({"content": PROSE}, 415, "no format that is known"),
    "gzipped": ({"content": gzip.compress(PICTURE)}, 415, "a PNG picture"),
    "zipped": ({"content": zipped(PICTURE, PROSE)}, 415, "a PNG picture"),
    "form": ({"files": {"file": ("x.csv", PICTURE)}}, 415, "a PNG picture"),
    "several": ({"files": [("file", ("a", PICTURE)), ("file", ("b", PROSE))]}, 415, "a PNG picture"),
    "header": ({"content": SENSORS}, 422, "lacks required columns: lat_deg, lon_deg"),
    "columns": ({"content": CSV, "params": {"columns": "alt_msl_m=Hoehe"}}, 422, "no 'Hoehe'"),
    "gzip": ({"content": gzip.compress(CSV)[:5]}, 422, "beginning of a gzip"),
}


def test_the_service_refuses_what_is_no_log_and_keeps_nothing(web: Any) -> None:
    for request_, status, said in REFUSED.values():
        answer = web.client.post("/v1/drives", **request_)
        assert answer.status_code == status, answer.text
        assert answer.headers["content-type"] == "application/problem+json"
        assert said in answer.json()["detail"]
        with web.sessions() as session:
            assert session.execute(text("SELECT count(*) FROM drives")).scalar_one() == 0
        assert [path for path in (web.settings.data_dir / "blobs").rglob("*") if path.is_file()] == []
    together = [("file", ("a", PICTURE)), ("file", ("b", CSV))]
    assert web.client.post("/v1/drives", files=together).status_code == 202
    assert web.client.post("/v1/drives", content=zipped(PROSE, CSV)).status_code == 202
