"""Files that want more than to be imported: others' bytes, the disk, the store."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from app.core.blobs import IMPORTS
from problem_support import check
from web_fixtures import Web

Work = Callable[..., list[str]]
SECRET = b"a secret of the worker's, byte for byte "


def vrt(source: str, side: int) -> bytes:
    """A raster whose posts are the bytes of another file."""
    return (
        f'<VRTDataset rasterXSize="{side}" rasterYSize="{side}"><SRS>EPSG:4326</SRS>'
        "<GeoTransform>8.4, 0.001, 0, 49.1, 0, -0.001</GeoTransform>"
        '<VRTRasterBand dataType="Byte" band="1" subClass="VRTRawRasterBand">'
        f'<SourceFilename relativeToVRT="0">{source}</SourceFilename>'
        f"<PixelOffset>1</PixelOffset><LineOffset>{side}</LineOffset></VRTRasterBand></VRTDataset>"
    ).encode()


def ask(web: Web, content: bytes, kind: str, name: str) -> Any:
    return web.client.post("/v1/operations", params={"kind": kind, "filename": name}, content=content)


@pytest.mark.parametrize("name", ["passwd.tif", "passwd.vrt", "N49E008.hgt"])
def test_a_raster_does_not_give_away_the_worker_s_files(web: Web, work: Work, name: str) -> None:
    secret = web.settings.data_dir / "secret"
    secret.write_bytes(SECRET * 40)
    answer = ask(web, vrt(str(secret), 40), "import-dem", name)
    assert answer.status_code == 202, answer.text
    assert work(web) == ["failed"]
    failure = web.client.get(f"/v1/operations/{answer.json()['id']}").json()["failure"]
    assert failure["kind"] == "bad-terrain"
    assert "names other files" in failure["reason"]
    assert web.client.get("/v1/rasters").json()["rasters"] == []
    kept = [path for path in web.settings.data_dir.rglob("*") if path.is_file() and path != secret]
    assert not any(SECRET in path.read_bytes() for path in kept)


def test_files_that_wait_take_a_bounded_part_of_the_store(settings: Any, server_maker: Any) -> None:
    with server_maker(settings.model_copy(update={"imports_kept_bytes": 250_000})) as web:
        for k in range(2):
            assert ask(web, bytes([k]) * 100_000, "import-roads", "x.osm").status_code == 202
        for content in (b"y" * 100_000, iter([b"y" * 100_000])):
            refused = ask(web, content, "import-roads", "x.osm")  # type: ignore[arg-type]
            check(refused, 503)
            assert "VERSANT_IMPORTS_KEPT_BYTES" in refused.json()["detail"]
        assert len(web.context.part(IMPORTS).keys()) == 2
        assert ask(web, b"z" * 40_000, "import-roads", "x.osm").status_code == 202


@pytest.mark.parametrize("name", ["..", ".", "x" * 250 + ".tif", "a/../../b.tif", "\u00e9" * 200 + ".tif"])
def test_a_name_leads_nowhere_else(web: Web, work: Work, name: str) -> None:
    answer = ask(web, b"This is a letter.", "import-dem", name)
    if answer.status_code == 202:
        assert work(web) == ["failed"]
        failure = web.client.get(f"/v1/operations/{answer.json()['id']}").json()["failure"]
        assert failure["kind"] == "bad-terrain", failure
    else:
        check(answer, 422)
