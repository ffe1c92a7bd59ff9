"""What a raster may make GDAL and PROJ open: itself. Names that it gives lead to a server that counts who asks."""

from __future__ import annotations

import gzip
import shutil
import socket
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
import rasterio
import rasterio.shutil
from affine import Affine

from fusion.errors import TerrainError
from fusion.terrain.dem import Dem
from fusion.terrain.drivers import BLOCK_BYTES, refuse_files_of_proj
from fusion.terrain.raster import refuse_void

Write = Callable[..., Path]
POSTS = Affine(0.001, 0, 8.0, 0, -0.001, 49.0)
PLACE = 8.01, 48.99


class Listener:
    """Counts requests on the loopback network and answers 404."""

    def __init__(self) -> None:
        self.asked: list[bytes] = []
        self._socket = socket.create_server(("127.0.0.1", 0))
        threading.Thread(target=self._serve, daemon=True).start()

    def address(self, name: str) -> str:
        return f"/vsicurl/http://127.0.0.1:{self._socket.getsockname()[1]}/{name}"

    def has_been_asked(self) -> bool:
        for _ in range(50):
            if not self.asked:
                time.sleep(0.1)
        return bool(self.asked)

    def close(self) -> None:
        self._socket.close()

    def _serve(self) -> None:
        while True:
            try:
                connection, _ = self._socket.accept()
            except OSError:
                return
            with connection:
                self.asked.append(connection.recv(4096).partition(b"\r\n")[0])
                connection.sendall(b"HTTP/1.1 404 no\r\nContent-Length: 0\r\nConnection: close\r\n\r\n")


@pytest.fixture
def listener(monkeypatch: pytest.MonkeyPatch) -> Iterator[Listener]:
    monkeypatch.setenv(
        "GDAL_HTTP_TIMEOUT", "1"
    )  # GDAL may hold the lock that the listener's thread waits for
    found = Listener()
    yield found
    found.close()


def vrt_of(source: str, side: int = 40, raw: bool = False) -> str:
    band = (
        '<VRTRasterBand dataType="Byte" band="1" subClass="VRTRawRasterBand">'
        f'<SourceFilename relativeToVRT="0">{source}</SourceFilename>'
        f"<PixelOffset>1</PixelOffset><LineOffset>{side}</LineOffset></VRTRasterBand>"
        if raw
        else f'<VRTRasterBand dataType="Float32" band="1"><SimpleSource><SourceFilename relativeToVRT="0">{source}'
        "</SourceFilename></SimpleSource></VRTRasterBand>"
    )
    return (
        f'<VRTDataset rasterXSize="{side}" rasterYSize="{side}"><SRS>EPSG:4326</SRS>'
        f"<GeoTransform>8, 0.001, 0, 49, 0, -0.001</GeoTransform>{band}</VRTDataset>"
    )


@pytest.mark.parametrize("name", ["passwd.tif", "N48E008.hgt", "a.vrt", "a.asc", "a"])
def test_a_vrt_is_read_by_no_name_and_asks_nobody(tmp_path: Path, listener: Listener, name: str) -> None:
    secret = tmp_path / "secret"
    secret.write_bytes(b"s" * 1600)
    for source, raw in ((listener.address(f"{name}.tif"), False), (str(secret), True)):
        (tmp_path / name).write_text(vrt_of(source, raw=raw))
        with pytest.raises(TerrainError, match=r"names other files|cannot be read as a raster"):
            Dem.open([tmp_path / name])
    assert listener.asked == []


def test_what_the_operator_names_may_refer_to_other_files(tmp_path: Path, write_raster: Write) -> None:
    tile = write_raster(tmp_path / "tile.tif", np.full((40, 40), 7.0), POSTS)
    (tmp_path / "all.vrt").write_text(vrt_of(str(tile)))
    with Dem.open([tmp_path / "all.vrt"], trusted=True) as dem:
        assert dem.heights(*PLACE) == 7.0


@pytest.mark.parametrize("beside", [".ovr", ".aux.xml", "metadata"])
def test_neither_what_lies_beside_a_raster_nor_what_it_names_is_opened(
    tmp_path: Path, write_raster: Write, listener: Listener, beside: str
) -> None:
    path = write_raster(tmp_path / "a.tif", np.full((600, 600), 7.0), POSTS)
    address = listener.address(f"inner{beside}")
    if beside == "metadata":
        with rasterio.open(path, "r+") as dataset:
            dataset.update_tags(ns="OVERVIEWS", OVERVIEW_FILE=address)
    elif beside == ".aux.xml":
        content = f'<Metadata domain="OVERVIEWS"><MDI key="OVERVIEW_FILE">{address}</MDI></Metadata>'
        Path(f"{path}{beside}").write_text(f"<PAMDataset>{content}</PAMDataset>")
    else:
        Path(f"{path}{beside}").write_text(vrt_of(address, 600))
    refuse_void(path)
    with Dem.open([path]) as dem:
        assert dem.heights(*PLACE) == 7.0
    assert listener.asked == []
    with rasterio.open(path) as dataset:  # the trap is one: by default GDAL asks
        assert dataset.files and dataset.overviews(1) is not None
    assert listener.has_been_asked()


@pytest.mark.parametrize("header", [b"II*\x00", b"MM\x00*", b"II+\x00"])
def test_a_vrt_behind_the_first_bytes_of_a_tiff_is_none(
    tmp_path: Path, listener: Listener, header: bytes
) -> None:
    (tmp_path / "a.tif").write_bytes(header + vrt_of(listener.address("polyglot")).encode())
    with pytest.raises(TerrainError, match="cannot be read as a raster"):
        Dem.open([tmp_path / "a.tif"])
    assert listener.asked == []


@pytest.mark.parametrize(
    "grid",
    [
        'EXTENSION["PROJ4_GRIDS","/etc/passwd"]',
        'EXTENSION["PROJ4","+proj=longlat +nadgrids=@null,../../secret +no_defs"]',
        'EXTENSION["PROJ4","+proj=longlat +geoidgrids=https://127.0.0.1/x +no_defs"]',
        'EXTENSION["PROJ4","+init=/tmp/file:1"]',
        'PARAMETERFILE["Geoid","secret.gtx"]',
    ],
)
def test_a_reference_system_that_names_a_file_is_refused(grid: str) -> None:
    with pytest.raises(TerrainError, match="names a file"):
        refuse_files_of_proj("a.tif", f'GEOGCS["x",DATUM["d",SPHEROID["s",6378137,298],{grid}]]')


@pytest.mark.parametrize("code", [4326, 3857, 25832, 9707, 31467, 2056, 27700, 4979])
def test_usual_reference_systems_name_none(code: int) -> None:
    refuse_files_of_proj("a.tif", rasterio.crs.CRS.from_epsg(code).to_wkt())


def test_a_block_of_gigabytes_for_one_post_is_refused_by_its_header(tmp_path: Path) -> None:
    side = 16384
    assert side**2 * 2 > BLOCK_BYTES
    profile = {
        "driver": "GTiff",
        "width": 400_000,
        "height": 400_000,
        "count": 1,
        "dtype": "int16",
        "crs": 4326,
    }
    tiled = {"tiled": True, "blockxsize": side, "blockysize": side, "sparse_ok": True, "bigtiff": True}
    with rasterio.open(tmp_path / "a.tif", "w", transform=POSTS, **profile, **tiled):
        pass
    assert (tmp_path / "a.tif").stat().st_size < 20_000
    with pytest.raises(TerrainError, match="16384 x 16384 posts"):
        Dem.open([tmp_path / "a.tif"])


def test_a_tile_of_dted_is_read_and_a_zip_of_a_tile_is_not(tmp_path: Path) -> None:
    profile = {"driver": "GTiff", "width": 1201, "height": 1201, "count": 1, "dtype": "int16", "crs": 4326}
    posts = Affine(1 / 1200, 0, 8 - 0.5 / 1200, 0, -1 / 1200, 49 + 0.5 / 1200)
    with rasterio.open(tmp_path / "a.tif", "w", transform=posts, **profile) as dataset:
        dataset.write(np.full((1201, 1201), 7, np.int16), 1)
    rasterio.shutil.copy(tmp_path / "a.tif", tmp_path / "a.dt1", driver="DTED")
    with Dem.open([tmp_path / "a.dt1"]) as dem:
        assert dem.heights(8.5, 48.5) == 7.0
    (tmp_path / "N48E008.hgt").write_bytes(np.full((1201, 1201), 7, ">i2").tobytes())
    shutil.make_archive(str(tmp_path / "N48E008.hgt"), "zip", tmp_path, "N48E008.hgt")
    with pytest.raises(TerrainError, match="neither a GeoTIFF"):
        Dem.open([tmp_path / "N48E008.hgt.zip"])


def test_a_gzip_of_a_vrt_is_known_by_what_is_in_it(tmp_path: Path, listener: Listener) -> None:
    packed = gzip.compress(vrt_of(listener.address("packed")).encode())
    for name in ("a.tif.gz", "N48E008.hgt.gz"):
        (tmp_path / name).write_bytes(packed)
        with pytest.raises(TerrainError):
            Dem.open([tmp_path / name])
    assert listener.asked == []


def test_a_large_void_raster_is_not_looked_through(tmp_path: Path) -> None:
    profile = {
        "driver": "GTiff",
        "width": 60_000,
        "height": 60_000,
        "count": 1,
        "dtype": "int16",
        "crs": 4326,
    }
    tiled = {"tiled": True, "blockxsize": 4096, "blockysize": 4096, "sparse_ok": True, "nodata": -9999}
    with rasterio.open(tmp_path / "a.tif", "w", transform=POSTS @ Affine.scale(1e-4), **profile, **tiled):
        pass
    looks: list[float] = []
    refuse_void(tmp_path / "a.tif", lambda _, share: looks.append(share))  # neither for long nor for nothing
    assert 10 < len(looks) < 200
    assert looks == sorted(looks)
