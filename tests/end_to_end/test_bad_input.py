"""Whatever is uploaded: a sentence that says what is wrong, and the worker goes on to the next drive."""

from __future__ import annotations

import gzip
import io
import re
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from app.cli.client import Client, ClientError
from fusion.simulate.demonstration import Demonstration
from tests.end_to_end.conftest import Up

pytestmark = pytest.mark.slow

HEADER = "time_s,lat_deg,lon_deg,alt_msl_m\n"
START_S = 1_717_400_000
WAIT_S = 240.0  # patience, no bound: on a machine that compiles everything for the first time a drive waits for that


def rows(count: int, *, time_s: float = START_S, lat_deg: float = 47.99, lon_deg: float = 7.85) -> str:
    return HEADER + "".join(f"{time_s + k},{lat_deg + k * 1e-5},{lon_deg},250\n" for k in range(count))


def _zipped(bundle: Demonstration | None, *, encrypted: bool = False) -> bytes:
    """A zip of a drive, or of pictures."""
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        for k in range(2):
            archive.writestr(f"{k}", bundle.drives[k].read_bytes() if bundle else b"\x89PNG\r\n\x1a\n%d" % k)
    data = bytearray(out.getvalue())
    if encrypted:
        data[data.index(b"PK\x01\x02") + 8] |= 1
    return bytes(data)


BAD: dict[str, tuple[Callable[[Demonstration], bytes], str]] = {
    "empty.csv": (lambda bundle: b"", "empty|no byte"),
    "cut.ubx": (lambda bundle: bundle.drives[1].read_bytes()[:61], "position|truncated|cut"),
    "columns.csv": (lambda bundle: b"time_s,speed_mps\n1,2\n3,4\n", "lat_deg"),
    "time.csv": (lambda bundle: rows(60, time_s=1e12).encode(), "time"),
    "lat91.csv": (lambda bundle: rows(60, lat_deg=91).encode(), "lat_deg is 91"),
    "far.csv": (lambda bundle: rows(60, lat_deg=-30, lon_deg=-120).encode(), "road"),
    "three.csv": (lambda bundle: rows(3).encode(), "3"),
    "bomb.csv.gz": (
        lambda bundle: gzip.compress(HEADER.encode() + b"0,0,0,0\n" * (25 * 2**20), 9),
        "bomb|decompress",
    ),
    "cut.zip": (lambda bundle: _zipped(bundle)[:-500], "zip cannot be read"),
    "locked.zip": (lambda bundle: _zipped(bundle, encrypted=True), "password"),
    "pictures.zip": (lambda bundle: _zipped(None), "format|PNG|recogni|log"),
    "picture.png": (lambda bundle: b"\x89PNG\r\n\x1a\n" + bytes(range(256)) * 20, "format|PNG|recogni"),
}


@pytest.fixture(scope="module")
def client(running: Up) -> Iterator[Client]:
    with running.client() as client:
        yield client


def complaint(client: Client, path: Path) -> str:
    """Upload, and return the sentence that came back: at once, or with the failed drive."""
    try:
        drive = client.upload(path)
    except ClientError as refused:
        return str(refused)
    final = client.wait(drive.id, timeout_s=WAIT_S)
    assert final.status == "failed", final.document
    assert final.reason
    return final.reason


@pytest.mark.parametrize("name", BAD)
def test_bad_input_ends_with_a_sentence(
    name: str, client: Client, simulated: Demonstration, tmp_path: Path
) -> None:
    make, expected = BAD[name]
    path = tmp_path / name
    path.write_bytes(make(simulated))
    said = complaint(client, path)
    assert re.search(expected, said, re.IGNORECASE), said
    assert re.match(r"[A-Z0-9].*[.!]$", said, re.DOTALL), said
    assert len(said.split()) >= 6, said
    assert "Traceback" not in said
    assert "internal" not in said.lower(), said


def test_worker_goes_on_after_all_of_them(client: Client, simulated: Demonstration, tmp_path: Path) -> None:
    waiting = []
    for name, (make, _) in BAD.items():
        path = tmp_path / name
        path.write_bytes(make(simulated) + b" ")  # other bytes than before, so another drive
        try:
            waiting.append(client.upload(path))
        except ClientError:
            continue
    path = tmp_path / "good.csv"
    path.write_bytes(simulated.drives[2].read_bytes() + b"\n\n")
    good = client.upload(path)
    assert client.wait(good.id, timeout_s=WAIT_S).status == "done"
    assert {client.wait(drive.id, timeout_s=WAIT_S).status for drive in waiting} == {"failed"}


def test_unknown_method_is_refused_with_the_known_ones(client: Client, simulated: Demonstration) -> None:
    with pytest.raises(ClientError, match="particle"):
        client.upload(simulated.drives[0], method="nonsense")


def test_addresses_that_name_nothing(running: Up) -> None:
    with running.http() as http:
        for path in ("/v1/drives/7", "/nowhere", "/v1/segments/x", "/collections/segments/items/0"):
            answer = http.get(path)
            assert answer.status_code == 404
            assert answer.headers["Content-Type"].startswith("application/problem+json")
            assert answer.json()["detail"].endswith(".")
