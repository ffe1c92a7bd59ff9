"""Files that belong together: one drive however they are sent, and nothing left of what is refused."""

from __future__ import annotations

import gzip
import io
import zipfile
from concurrent.futures import ThreadPoolExecutor
from itertools import permutations
from pathlib import Path
from typing import Any

import httpx
import pytest
from sqlalchemy import text

from app.core.blobs import BlobStore
from app.core.errors import BadRequestError, StorageFullError
from app.core.receiving.body import Piece
from app.drives.intake import register_upload
from app.drives.process import Outcome
from app.drives.receiving.first_look import FirstLook
from app.drives.receiving.upload_bundle import UploadBundle
from app.jobs.context import JobContext
from fusion.formats import read_log
from fusion.published.canyon.drive import canyon_of
from fusion.simulate.drive import simulate_drive
from fusion.simulate.scene.town import Town
from fusion.simulate.write.rinex_file import navigation, observations
from processing_support import HEADER, drive_now, process_drive
from web_fixtures import TLS

OBS, NAV, IMU = HEADER + b"observations " * 300, b"navigation " * 400, b"1,2,3\r\n" * 500
NAMED = [("a.obs", OBS), ("a.nav", NAV), ("imu.csv", IMU)]


def form(files: list[tuple[str, bytes]]) -> dict[str, Any]:
    return {"files": [("file", file) for file in files]}


def zipped(files: list[tuple[str, bytes]], method: int = zipfile.ZIP_DEFLATED) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", method) as archive:
        for name, data in files:
            archive.writestr(name, data)
    return out.getvalue()


def left(web: Any) -> list[str]:
    """Parts of uploads that are still there."""
    return [path.name for path in (web.settings.data_dir / "blobs" / "incoming").glob("*")]


def test_parts_a_zip_and_any_order_are_one_drive(web: Any) -> None:
    packed = [(f"{name}.gz", gzip.compress(data)) for name, data in NAMED]
    forms: list[dict[str, Any]] = [form(list(order)) for order in permutations(NAMED)]
    forms += [form(packed), form([("all.zip", zipped(NAMED))])]
    forms += [{"content": zipped(files, zipfile.ZIP_STORED)} for files in (NAMED[::-1], packed)]

    def upload(one: dict[str, Any]) -> httpx.Response:
        return httpx.post(f"{web.base}/v1/drives", **one, trust_env=False, timeout=60, verify=TLS)

    with ThreadPoolExecutor(4) as pool:
        answers = list(pool.map(upload, forms))
    assert sorted(answer.status_code for answer in answers) == [200] * (len(forms) - 1) + [202]
    assert len({answer.headers["location"] for answer in answers}) == 1
    assert len(web.blobs.keys()) == 1
    assert left(web) == []
    other = web.client.post("/v1/drives", **form([("a.obs", OBS), ("a.nav", NAV)]))
    assert other.status_code == 202
    assert other.headers["location"] != answers[0].headers["location"]


def test_several_parts_are_kept_as_one_zip(web: Any) -> None:
    answer = web.client.post("/v1/drives", **form([*NAMED, ("../x/a.obs", b"more")]))
    assert answer.status_code == 202, answer.text
    drive = web.client.get(answer.headers["location"]).json()
    assert drive["filename"] == "a.obs, a.nav, imu.csv, a.obs"
    (key,) = web.blobs.keys()
    with web.blobs.open(key) as file, zipfile.ZipFile(file) as archive:
        assert {info.filename: archive.read(info) for info in archive.infolist()} == {
            **dict(NAMED),
            "a-2.obs": b"more",
        }
        assert drive["size_bytes"] == file.seek(0, 2)


def test_a_zip_is_kept_as_it_came_and_with_one_file_it_is_that_file(web: Any) -> None:
    alone = web.client.post("/v1/drives", **form([("a.obs", OBS)]))
    again = web.client.post("/v1/drives", content=zipped([("day/a.obs", OBS)]))
    assert (alone.status_code, again.status_code) == (202, 200)
    data = zipped(NAMED)
    assert web.client.post("/v1/drives?filename=all.zip", content=data).status_code == 202
    (key,) = [key for key in web.blobs.keys() if read(web.blobs, key).startswith(b"PK")]  # noqa: SIM118
    assert read(web.blobs, key) == data


def read(blobs: BlobStore, key: str) -> bytes:
    with blobs.open(key) as file:
        return file.read()


def test_the_limit_is_on_the_sum_of_the_files(web: Any) -> None:
    most = web.settings.max_upload_bytes
    for more, status in ((0, 202), (1, 413)):
        files = [
            ("a", HEADER.ljust(70_000, b"a")),
            ("b", b"b" * 70_000),
            ("c", b"c" * (most - 140_000 + more)),
        ]
        assert web.client.post("/v1/drives", **form(files)).status_code == status
    assert len(web.blobs.keys()) == 1
    assert left(web) == []


REFUSED: list[tuple[dict[str, Any], int, str]] = [
    (form([("a", OBS), ("b", b"")]), 422, "'b' is empty"),
    (form([("a", b""), ("b", OBS)]), 422, "'a' is empty"),
    (form([("a", OBS), ("b", NAV), ("c.gz", gzip.compress(OBS))]), 422, "'a' and 'c.gz' hold the same"),
    (form([("a", OBS), ("b.zip", zipped(NAMED))]), 415, "'b.zip' is a zip itself"),
    (form([("b.zip", zipped(NAMED)), ("a", OBS)]), 415, "'b.zip' is a zip itself"),
    (form([(f"{k}", b"%d" % k) for k in range(33)]), 413, "more than 32 files"),
    ({"content": zipped(NAMED)[:-40]}, 422, "cannot be read"),
    (form([("cut.zip", zipped(NAMED)[:200])]), 422, "cannot be read"),
    ({"content": zipped([("a", b"")])}, 422, "holds no file"),
    ({"content": zipped([("all.zip", zipped(NAMED))])}, 415, "is a zip itself"),
    ({"content": zipped([("a", bytes(70 << 20))])}, 413, "bomb"),
]


def test_what_is_refused_leaves_nothing(web: Any) -> None:
    for request_, status, said in REFUSED:
        answer = web.client.post("/v1/drives", **request_)
        assert answer.status_code == status, answer.text
        assert answer.headers["content-type"] == "application/problem+json"
        assert said in answer.json()["detail"]
        assert [error["field"] for error in answer.json()["errors"]] == ["file"]
        assert (web.blobs.keys(), left(web)) == ([], [])
    with web.sessions() as session:
        assert session.execute(text("SELECT count(*) FROM drives")).scalar_one() == 0


@pytest.fixture(params=["folder", "memory", "bucket"])
def blobs(request: pytest.FixtureRequest, tmp_path: Path) -> BlobStore:
    """Stores of every kind."""
    urls = {"folder": str(tmp_path / "blobs"), "memory": f"memory://{tmp_path.name}"}
    url = urls.get(request.param) or f"{request.getfixturevalue('bucket')}/logs"
    return BlobStore(url)


def bundle_in(blobs: BlobStore) -> UploadBundle:
    return UploadBundle(
        blobs, keep_free_bytes=0, expected_bytes=0, max_content_bytes=1 << 20, look=FirstLook()
    )


def test_every_store_keeps_files_and_zips_and_forgets_what_is_refused(blobs: BlobStore) -> None:
    several, single, refused = bundle_in(blobs), bundle_in(blobs), bundle_in(blobs)
    several.take([Piece(k, name, data) for k, (name, data) in enumerate(NAMED)])
    single.take([Piece(0, "all.zip", zipped(NAMED))])
    refused.take([Piece(0, "all.zip", zipped(NAMED)[:300])])
    one, other = several.finish()[0], single.finish()[0]
    with pytest.raises(BadRequestError):
        refused.finish()
    refused.discard()
    assert one.content_sha256 == other.content_sha256
    assert blobs.keys() == sorted([one.key, other.key])
    assert blobs._list("incoming") == []
    with zipfile.ZipFile(io.BytesIO(read(blobs, one.key))) as archive:
        assert [(name, archive.read(name)) for name in archive.namelist()] == NAMED


def test_a_disk_that_fills_up_in_the_middle_of_a_zip_leaves_nothing(
    blobs: BlobStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    broken = bundle_in(blobs)
    broken.take([Piece(0, "a.obs", OBS), Piece(1, "a.nav", NAV)])
    monkeypatch.setattr("app.core.filesystems.free_bytes", lambda fs, root: 10)
    broken._writer._keep_free_bytes = 1
    with pytest.raises(StorageFullError):
        broken.take([Piece(1, "a.nav", NAV)])
    broken.discard()
    assert (blobs.keys(), blobs._list("incoming")) == ([], [])


def test_a_worker_reads_files_that_came_apart_as_one_log(context: JobContext, files: Path) -> None:
    header, *rows = (files / "1.csv").read_text().splitlines(keepends=True)
    halves = ["".join([header, *part]).encode() for part in (rows[: len(rows) // 2], rows[len(rows) // 2 :])]
    several = bundle_in(context.blobs)
    several.take([Piece(1 - k, f"{k}.csv.gz", gzip.compress(halves[k])) for k in (1, 0)])
    blob, name = several.finish()
    drive, _ = register_upload(context.sessions, context.blobs, blob, filename=name, method="raw")
    assert process_drive(context, drive.id, 1) is Outcome.DONE, drive_now(context, drive.id).failure
    done = drive_now(context, drive.id)
    assert done.filename == "1.csv.gz, 0.csv.gz"
    assert done.epochs == len(read_log(files / "1.csv").fix)
    assert done.bbox == pytest.approx(read_log(files / "1.csv").bounds_deg())


def test_observations_and_navigation_that_came_apart_are_positioned_and_fused(
    context: JobContext, town: Town
) -> None:
    raw = canyon_of(simulate_drive(town, 7, 120.0)).raw()
    texts = {"brdc.rnx": navigation(raw.navigation), "drive.rnx": observations(raw.signals)}
    sent = UploadBundle(
        context.blobs, keep_free_bytes=0, expected_bytes=0, max_content_bytes=1 << 24, look=FirstLook()
    )
    sent.take([Piece(k, name, text.encode()) for k, (name, text) in enumerate(texts.items())])
    blob, name = sent.finish()
    drive, _ = register_upload(context.sessions, context.blobs, blob, filename=name, method="profile")
    assert process_drive(context, drive.id, 1) is Outcome.DONE, drive_now(context, drive.id).failure
    report = drive_now(context, drive.id).report
    assert report is not None
    assert report["gnss"]["positioning"] == "one-sided"
    assert report["gnss"]["solved"] == report["epochs"] == len(raw.signals)
    assert report["segments_estimated"] > 3
