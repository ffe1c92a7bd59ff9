"""The files in a body: forms cut anywhere, names of any kind."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from starlette.datastructures import Headers, QueryParams

from app.core.errors import BadRequestError
from app.core.receiving.body import MultipartBody, clean_filename, joined, upload_source


@settings(max_examples=60, deadline=None)
@given(
    files=st.lists(st.binary(max_size=200).filter(lambda d: b"\r\n--bound" not in d), min_size=1, max_size=3),
    cuts=st.lists(st.integers(0, 900), max_size=8),
)
def test_a_form_can_be_cut_anywhere(files: list[bytes], cuts: list[int]) -> None:
    body = b'--bound\r\nContent-Disposition: form-data; name="note"\r\n\r\nhello\r\n'
    for data in files:
        body += (
            b'--bound\r\nContent-Disposition: form-data; name="file"; filename="\xc3\xa4.ubx"\r\n'
            b"Content-Type: application/octet-stream\r\n\r\n" + data + b"\r\n"
        )
    body += b"--bound--\r\n"
    source = MultipartBody(b"bound", "upload")
    places = sorted({0, len(body), *(cut for cut in cuts if cut < len(body))})
    pieces = [piece for a, b in pairwise(places) for piece in source.feed(body[a:b])]
    source.finish()
    assert joined(pieces) == [(k, "ä.ubx", data) for k, data in enumerate(files)]


def test_a_file_without_a_name_has_the_name_that_was_announced() -> None:
    source = upload_source(
        Headers({"Content-Type": "multipart/form-data; boundary=b"}), QueryParams({"filename": "a/x.ubx"})
    )
    part = b'--b\r\nContent-Disposition: form-data; name="file"%s\r\n\r\n1\r\n'
    pieces = source.feed(part % b'; filename="one.ubx"' + part % b"" + b"--b--\r\n")
    assert [piece.name for piece in pieces] == ["one.ubx", "x.ubx"]


def test_a_form_that_ends_early_is_noticed() -> None:
    source = MultipartBody(b"b", "upload")
    source.feed(b'--b\r\nContent-Disposition: form-data; name="file"\r\n\r\nhalf a l')
    with pytest.raises(BadRequestError, match="ends before"):
        source.finish()


@pytest.mark.parametrize(
    ("disposition", "name"),
    [
        ("attachment; filename=a.csv", "a.csv"),
        ("attachment; filename*=UTF-8''%C3%A4.csv", "ä.csv"),
        ("attachment; filename*=iso-8859-1'de'%E4.csv", "ä.csv"),
        ("attachment; filename*=idna''abc", "upload"),
        ("attachment; filename*=punycode''%ff-%ff", "upload"),
        ("attachment; filename*=undefined''zz", "upload"),
        ("attachment; filename*=rot13''zz", "upload"),
        ("attachment; filename*=a; filename*0=b", "upload"),
        (f"attachment; filename*{'9' * 5000}=b", "upload"),
        ("attachment; filename*=UTF-8''%ff", "\ufffd"),
        ("", "upload"),
    ],
)
def test_the_name_in_a_disposition(disposition: str, name: str) -> None:
    source = upload_source(Headers({"Content-Disposition": disposition}), QueryParams())
    assert source.feed(b"log") == [(0, name, b"log")]


@given(
    st.lists(st.sampled_from(["filename", "*", "0", "1", "=", ";", "'", "utf-8", "idna", "%ff", '"', "\xe4"]))
)
def test_no_disposition_is_a_fault_of_the_service(pieces: list[str]) -> None:
    header = Headers({"Content-Disposition": "attachment; " + "".join(pieces)})
    (piece,) = upload_source(header, QueryParams()).feed(b"log")
    assert piece.name


@given(st.text())
def test_file_names_hold_nothing_that_could_hurt(name: str) -> None:
    cleaned = clean_filename(name)
    assert 1 <= len(cleaned) <= 255
    assert not set(cleaned) & set("/\\\x00\n\r\t")
    assert cleaned == Path(cleaned).name or cleaned in {".", ".."}
