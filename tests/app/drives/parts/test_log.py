"""The log as it was uploaded: the same bytes under their name, in parts, and a plain word where it is lost."""

from __future__ import annotations

import io
import re
import zipfile
from typing import Any
from urllib.parse import unquote

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.drives.parts.reading import attachment, stem_of
from problem_support import check

LOG = b"time_s,lat_deg,lon_deg\n" + b"".join(b"%d,49.0,8.4\n" % (1_700_000_000 + k) for k in range(200))


def uploaded(web: Any, name: str = "monday.csv", content: bytes = LOG) -> str:
    return str(web.client.post("/v1/drives", files={"file": (name, content)}).json()["id"])


def test_the_bytes_come_back_as_a_file(web: Any) -> None:
    address = f"/v1/drives/{uploaded(web)}/log"
    answer = web.client.get(address)
    assert answer.content == LOG
    assert answer.headers["content-type"] == "application/octet-stream"
    assert answer.headers["content-disposition"] == 'attachment; filename="monday.csv"'
    assert answer.headers["x-content-type-options"] == "nosniff"
    assert answer.headers["content-length"] == str(len(LOG))
    assert "content-encoding" not in answer.headers
    assert web.client.get(address, headers={"If-None-Match": answer.headers["etag"]}).status_code == 304
    head = web.client.head(address)
    assert (head.headers["content-length"], head.content) == (str(len(LOG)), b"")


def test_a_part_of_it(web: Any) -> None:
    address = f"/v1/drives/{uploaded(web)}/log"
    answer = web.client.get(address, headers={"Range": "bytes=10-29"})
    assert (answer.status_code, answer.content) == (206, LOG[10:30])
    assert answer.headers["content-range"] == f"bytes 10-29/{len(LOG)}"
    assert web.client.get(address, headers={"Range": "bytes=-5"}).content == LOG[-5:]
    check(web.client.get(address, headers={"Range": f"bytes={len(LOG)}-"}), 416)


def test_several_files_are_one_zip(web: Any) -> None:
    files = [("file", ("a.csv", LOG)), ("file", ("b.csv", LOG.replace(b"49.0", b"49.1")))]
    drive = web.client.post("/v1/drives", params={"grouping": "one"}, files=files).json()["id"]
    answer = web.client.get(f"/v1/drives/{drive}/log")
    assert 'filename="a.csv, b.csv.zip"' in answer.headers["content-disposition"]
    assert sorted(zipfile.ZipFile(io.BytesIO(answer.content)).namelist()) == ["a.csv", "b.csv"]


def test_a_lost_file_is_said_to_be_lost(web: Any) -> None:
    drive = uploaded(web)
    for key in web.blobs.keys():  # noqa: SIM118 - no mapping
        web.blobs.delete(key)
    assert (
        "no longer in the service's storage"
        in check(web.client.get(f"/v1/drives/{drive}/log"), 404)["detail"]
    )


def test_the_log_of_a_removed_drive(web: Any) -> None:
    drive = uploaded(web)
    assert web.client.delete(f"/v1/drives/{drive}").status_code == 202
    check(web.client.get(f"/v1/drives/{drive}/log"), 404)


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("monday.ubx", 'attachment; filename="monday.ubx"'),
        ("../../etc/passwd", 'attachment; filename="passwd"'),
        ("C:\\logs\\a.csv", 'attachment; filename="a.csv"'),
        ("Straße.ubx", "attachment; filename=\"Stra_e.ubx\"; filename*=UTF-8''Stra%C3%9Fe.ubx"),
        (
            'a"; filename="b',
            "attachment; filename=\"a_; filename=_b\"; filename*=UTF-8''a%22%3B%20filename%3D%22b",
        ),
        ("", 'attachment; filename="file"'),
        ("a\r\nSet-Cookie: x", 'attachment; filename="a__Set-Cookie: x"'),
    ],
)
def test_names_are_safe_in_a_header(name: str, said: str) -> None:
    assert attachment(name) == said


@given(st.text())
def test_any_name_makes_a_header(name: str) -> None:
    header = attachment(name)
    assert re.fullmatch(r"attachment; filename=\"[ !#-\[\]-~]+\"(; filename\*=UTF-8''[\w.~%-]+)?", header)
    assert unquote(header).isprintable() or "%" in header
    assert stem_of(name)
