"""Files as one zip, and zips of strangers: one identity in every form, and a sentence for everything else."""

from __future__ import annotations

import gzip
import hashlib
import io
import zipfile
from collections.abc import Callable, Mapping

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.core.content import ContentHash
from app.core.errors import BadRequestError, BodyTooLargeError, ServiceError, UnsupportedBodyError
from app.drives.receiving.first_look import FirstLook
from app.drives.receiving.zips import ZipWriter, content_of_files, content_of_zip

MAX_BYTES = 80 << 20
FILES = {"a.obs": b"observations " * 400, "a.nav": b"navigation " * 300, "imu.csv": b"1,2,3\n" * 500}


def zipped(
    files: Mapping[str, bytes],
    method: int = zipfile.ZIP_DEFLATED,
    date: tuple[int, ...] = (2026, 1, 2, 3, 4, 6),
) -> bytes:
    """A zip as other programs make it."""
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        for name, data in files.items():
            archive.writestr(zipfile.ZipInfo(name, date), data, method)  # type: ignore[arg-type]
    return out.getvalue()


def bundled(files: Mapping[str, bytes], piece: int = 1000) -> tuple[bytes, str]:
    """The zip that is written of files, and what it says is their content."""
    out = bytearray()
    writer = ZipWriter(out.extend, MAX_BYTES)
    try:
        for name, data in files.items():
            writer.begin(name)
            for start in range(0, len(data), piece):
                writer.write(data[start : start + piece])
        content = writer.finish()
        return bytes(out), content
    except BaseException:
        writer.drop()
        raise


def content(data: bytes, max_bytes: int = MAX_BYTES) -> str:
    return content_of_zip(io.BytesIO(data), max_bytes, FirstLook())


def of_one(data: bytes) -> str:
    told = ContentHash(MAX_BYTES)
    told.update(data)
    return told.content_sha256()


def backwards(files: Mapping[str, bytes]) -> dict[str, bytes]:
    return dict(reversed(files.items()))  # type: ignore[call-overload]


FORMS: dict[str, bytes] = {
    "deflated": zipped(FILES),
    "stored": zipped(FILES, zipfile.ZIP_STORED),
    "another order": zipped(backwards(FILES)),
    "other names and times": zipped(
        {f"day/{k}": v for k, v in enumerate(FILES.values())}, date=(1999, 9, 9, 9, 9, 8)
    ),
    "gzipped members": zipped({name: gzip.compress(data) for name, data in FILES.items()}),
    "one gzipped member": zipped({**FILES, "a.nav": gzip.compress(FILES["a.nav"], 1)}),
    "with folders and what systems add": zipped(
        {
            "day/": b"",
            "empty.csv": b"",
            ".DS_Store": b"x",
            "__MACOSX/._a.obs": b"y",
            "__MACOSX/b": b"z",
            **FILES,
        }
    ),
    "a member twice": zipped({**FILES, "copy.obs": FILES["a.obs"]}),
    "written here": bundled(FILES)[0],
    "written here in another order": bundled(backwards(FILES))[0],
}


@pytest.mark.parametrize("form", FORMS)
def test_the_same_files_are_the_same_in_every_form(form: str) -> None:
    assert content(FORMS[form]) == bundled(FILES)[1] == content_of_files(map(of_one, FILES.values()))


def test_other_files_are_something_else() -> None:
    names = list(FILES)
    others = [
        {name: FILES[name] for name in names[:2]},
        {**FILES, "a.nav": b"other"},
        {**FILES, "more": b"more"},
        {**FILES, ".hidden": b"no system adds this"},
    ]
    digests = b"".join(sorted(hashlib.sha256(data).digest() for data in FILES.values()))
    contents = [content(zipped(files)) for files in (FILES, *others)]
    assert len({*contents, of_one(digests)}) == 6


def test_a_zip_with_one_file_is_that_file() -> None:
    assert content(zipped({"day/a.obs": FILES["a.obs"]})) == of_one(FILES["a.obs"])


@settings(max_examples=40, deadline=None)
@given(st.lists(st.binary(min_size=1, max_size=60), min_size=1, max_size=6, unique=True), st.integers(1, 70))
def test_a_zip_that_is_written_holds_what_was_sent(files: list[bytes], piece: int) -> None:
    named = {f"file {k}.obs": data for k, data in enumerate(files)}
    try:
        data, told = bundled(named, piece)
    except ServiceError:
        assert any(file.startswith(b"PK") or len(file) > 10 for file in files)  # a zip, or gzips of the same
        return
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        assert {info.filename: archive.read(info) for info in archive.infolist()} == named
        assert archive.testzip() is None
    assert (data, told) == bundled(named, piece + 1)
    assert content(data) == told


def test_names_are_unique_and_safe() -> None:
    out = bytearray()
    writer = ZipWriter(out.extend, MAX_BYTES)
    for k, name in enumerate(["a.obs", "A.obs", "a.obs", ".hidden.csv", "..", "ü.nav"]):
        writer.begin(name)
        writer.write(b"%d" % k)
    writer.finish()
    names = zipfile.ZipFile(io.BytesIO(bytes(out))).namelist()
    assert names == ["a.obs", "A-2.obs", "a-3.obs", "hidden.csv", "file", "ü.nav"]


def with_bytes(data: bytes, at: int, new: bytes) -> bytes:
    return data[:at] + new + data[at + len(new) :]


def encrypted() -> bytes:
    data = zipped({"a.obs": FILES["a.obs"]})
    directory = data.index(b"PK\x01\x02")
    return with_bytes(with_bytes(data, 6, b"\x01"), directory + 8, b"\x01")


WHOLE = zipped(FILES)
HOSTILE: dict[str, tuple[Callable[[], bytes], type[ServiceError], str]] = {
    "cut": (lambda: WHOLE[:-30], BadRequestError, "cannot be read"),
    "only its beginning": (lambda: WHOLE[:40], BadRequestError, "cannot be read"),
    "damaged": (lambda: with_bytes(WHOLE, 60, b"damage"), BadRequestError, "cannot be read"),
    "empty": (lambda: zipped({}), BadRequestError, "holds no file"),
    "only folders": (lambda: zipped({"day/": b"", "day/none.csv": b""}), BadRequestError, "holds no file"),
    "encrypted": (encrypted, UnsupportedBodyError, "without a password"),
    "bzip2": (lambda: zipped(FILES, zipfile.ZIP_BZIP2), UnsupportedBodyError, "deflate"),
    "nested": (
        lambda: zipped({**FILES, "../in\x1b.zip": WHOLE}),
        UnsupportedBodyError,
        "'in.zip' is a zip itself",
    ),
    "many": (lambda: zipped({str(k): b"%d" % k for k in range(33)}), BodyTooLargeError, "more than 32 files"),
    "large": (lambda: zipped({"a": bytes(MAX_BYTES + 1)}), BodyTooLargeError, "larger than"),
    "bomb": (lambda: zipped({"a": bytes(70 << 20)}), BodyTooLargeError, "bomb"),
    "a long table": (
        lambda: zipped({f"{k:0200}": b"" for k in range(5000)}, zipfile.ZIP_STORED),
        BodyTooLargeError,
        "more than 32 files",
    ),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_a_hostile_zip_is_refused_in_a_sentence(name: str) -> None:
    make, error, said = HOSTILE[name]
    with pytest.raises(error, match=said) as refused:
        content(make())
    assert [one.field for one in refused.value.errors] == ["file"]
    assert len(str(refused.value)) < 300


@settings(max_examples=150, deadline=None)
@given(st.integers(0, len(WHOLE) - 1), st.binary(min_size=1, max_size=8), st.integers(0, len(WHOLE)))
def test_no_damage_is_a_fault_of_the_service(at: int, new: bytes, end: int) -> None:
    for data in (with_bytes(WHOLE, at, new), WHOLE[:end], WHOLE[:4] + WHOLE[at:]):
        try:
            content(data)
        except ServiceError:
            continue


def refused(files: Mapping[str, bytes], error: type[ServiceError], said: str) -> None:
    with pytest.raises(error, match=said):
        bundled(files)


def test_files_that_cannot_be_one_drive_are_refused() -> None:
    refused({"a": b"x", "b": b""}, BadRequestError, "'b' is empty")
    refused({"a": b"", "b": b"x"}, BadRequestError, "'a' is empty")
    refused({"a": b"x", "b": b"y", "c": gzip.compress(b"x")}, BadRequestError, "'a' and 'c' hold the same")
    refused({"a": b"x", "b": WHOLE}, UnsupportedBodyError, "'b' is a zip itself")
    refused({str(k): b"%d" % k for k in range(33)}, BodyTooLargeError, "more than 32 files")
