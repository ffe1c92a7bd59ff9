"""A process that reads mutated files until its time is over: ``python -m reader_fuzz READER SEED SECONDS``.

Before each input it writes the seed, so that whoever started it knows what it died of: five seconds of processor time,
a gibibyte more of memory than it had after reading the samples, or an error that no reader may raise.
"""

from __future__ import annotations

import gzip
import io
import random
import re
import resource
import signal
import sys
import tempfile
import time
import zipfile
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path

import numpy as np
import osmium
import rasterio
from affine import Affine

from fusion.errors import FusionError, MalformedLogError
from fusion.formats import FORMATS, read_log
from fusion.roads.osm import read_roads
from fusion.roads.osm_changes import apply_changes, is_change_file, keep_roads
from fusion.simulate.scene.town import make_town
from fusion.simulate.write.osm_file import write_osm
from fusion.terrain.dem import Dem
from fusion.terrain.raster import refuse_void
from fusion.types import DriveLog
from log_samples import SAMPLES

MEMORY_BYTES = 1 << 30
CPU_S, WALL_S = 5.0, 60.0
_SHARED = Path(__file__).parents[3] / "shared" / "data" / "formats"
_SHARED_BYTES = 100_000
_NUMBERS = (0, 1, 0x7F, 0x80, 0xFF, 0x7FFF, 0xFFFF, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF)
_TEXTS = (
    b"nan",
    b"-1",
    b"1e308",
    b"9" * 400,
    b"0",
    b"",
    b"-0.0",
    b"2147483648",
    b"\xff\xfe",
    b"\x00",
    b"9" * 20,
)

Samples = Mapping[str, bytes]
Read = Callable[[bytes, Path], None]


def mutated(rng: random.Random, sample: bytes, others: list[bytes]) -> bytes:
    """The sample with a few faults in it."""
    data = bytearray(sample)
    for _ in range(rng.choice((1, 1, 2, 4, 16))):
        at = rng.randrange(len(data) + 1)
        length = min(rng.choice((1, 2, 4, 8, 64, 1000)), len(data) - at)
        rng.choice(_FAULTS)(rng, data, at, length, rng.choice(others))
    return bytes(data)


def _flip(rng: random.Random, data: bytearray, at: int, length: int, _: bytes) -> None:
    for k in range(at, at + min(length, 1)):
        data[k] ^= 1 << rng.randrange(8)


def _noise(rng: random.Random, data: bytearray, at: int, length: int, _: bytes) -> None:
    data[at : at + length] = rng.randbytes(length)


def _loss(_: random.Random, data: bytearray, at: int, length: int, __: bytes) -> None:
    del data[at : at + length]


def _repeat(rng: random.Random, data: bytearray, at: int, length: int, _: bytes) -> None:
    data[at:at] = data[at : at + length] * rng.choice((1, 2, 50))


def _number(rng: random.Random, data: bytearray, at: int, _: int, __: bytes) -> None:
    size = rng.choice((1, 2, 4, 8))
    number = rng.choice(_NUMBERS) % (1 << 8 * size)
    data[at : at + size] = number.to_bytes(size, rng.choice(("little", "big")))


def _text(rng: random.Random, data: bytearray, at: int, _: int, __: bytes) -> None:
    found = list(re.finditer(rb"-?\d+(?:\.\d+)?", data[at : at + 200]))
    if found:
        one = rng.choice(found)
        data[at + one.start() : at + one.end()] = rng.choice(_TEXTS)


def _splice(rng: random.Random, data: bytearray, at: int, length: int, other: bytes) -> None:
    begin = rng.randrange(len(other) + 1)
    data[at : at + length] = other[begin : begin + rng.choice((8, 200, 5000))]


def _cut(rng: random.Random, data: bytearray, at: int, _: int, __: bytes) -> None:
    if rng.random() < 0.3:
        del data[at:]


_FAULTS = (_flip, _noise, _loss, _repeat, _number, _text, _splice, _cut)


def logs() -> tuple[Samples, Read]:
    """Every format of the registry, and what is there of real files."""
    assert set(SAMPLES) == set(FORMATS)
    samples = dict(SAMPLES)
    if _SHARED.is_dir():
        samples |= {path.name: path.read_bytes()[:_SHARED_BYTES] for path in sorted(_SHARED.iterdir())}
    return samples, _read_log


def archives() -> tuple[Samples, Read]:
    """Logs as zip and gzip, in each other."""

    def zipped(names: list[str], method: int = zipfile.ZIP_DEFLATED) -> bytes:
        out = io.BytesIO()
        with zipfile.ZipFile(out, "w", method) as archive:
            for name in names:
                archive.writestr(f"{name}.txt", SAMPLES[name])
        return out.getvalue()

    samples = {f"{name}.gz": gzip.compress(content) for name, content in SAMPLES.items()}
    samples |= {
        "two.zip": zipped(["rinex", "nmea"]),
        "stored.zip": zipped(["csv", "ubx"], zipfile.ZIP_STORED),
    }
    samples |= {"zip.gz": gzip.compress(zipped(["csv"])), "gz.gz": gzip.compress(samples["ubx.gz"])}
    return samples, _read_log


def roads() -> tuple[Samples, Read]:
    """OSM as XML, gzip and PBF, and changes."""

    folder = Path(tempfile.mkdtemp())
    write_osm(make_town(), folder / "town.osm")
    keep_roads(folder / "town.osm", folder / "kept.osm.pbf")
    xml = (folder / "town.osm").read_bytes()
    nodes = b"".join(re.findall(rb"<node .*?/>", xml)[:40])
    change = b'<osmChange version="0.6"><modify>' + nodes + b"</modify></osmChange>"
    with osmium.SimpleWriter(str(folder / "town.osm.pbf")) as writer:
        for one in osmium.FileProcessor(str(folder / "town.osm")):
            writer.add(one)

    def read(data: bytes, path: Path) -> None:
        path.write_bytes(data)
        if is_change_file(path):
            apply_changes(folder / "kept.osm.pbf", path, folder / "new.osm.pbf", (-180, -90, 180, 90))
        else:
            read_roads(path)

    pbf = (folder / "town.osm.pbf").read_bytes()
    return {
        "osm": xml,
        "osm.gz": gzip.compress(xml),
        "pbf": pbf,
        "osc": change,
        "osc.gz": gzip.compress(change),
    }, read


def elevation() -> tuple[Samples, Read]:
    """GeoTIFF in several ways, and what refers to other files."""

    folder = Path(tempfile.mkdtemp())
    samples = {}
    tiles = {"tiled": True, "blockxsize": 64, "blockysize": 64, "compress": "lzw"}
    ways: dict[str, dict[str, object]] = {
        "plain": {},
        "deflate": {"compress": "deflate", "predictor": 2},
        "tiled": tiles,
        "big": {"bigtiff": "yes"},
    }
    for name, way in ways.items():
        profile = {"driver": "GTiff", "width": 100, "height": 90, "count": 1, "dtype": "int16", "crs": 25832}
        posts = Affine(30, 0, 456_000, 0, -30, 5_428_000)
        with rasterio.open(folder / name, "w", transform=posts, nodata=-9999, **profile, **way) as raster:
            raster.write(np.arange(9000, dtype=np.int16).reshape(90, 100) % 700, 1)
        samples[name] = (folder / name).read_bytes()
    samples["vrt"] = b'<VRTDataset rasterXSize="9" rasterYSize="9"><SRS>EPSG:4326</SRS></VRTDataset>'
    names = ("a.tif", "a.tif.gz", "N48E008.hgt", "a.vrt")

    def read(data: bytes, path: Path) -> None:
        path = path.with_name(names[len(data) % len(names)])
        path.write_bytes(gzip.compress(data, 1) if path.suffix == ".gz" else data)
        refuse_void(path)
        with Dem.open([path]) as dem:
            dem.heights(np.linspace(8.3, 8.5, 50), np.linspace(48.9, 49.1, 50))

    return samples, read


READERS = {"logs": logs, "archives": archives, "roads": roads, "elevation": elevation}


def _read_log(data: bytes, _: Path) -> None:
    try:
        log = read_log(data, max_bytes=64 << 20)
    except MalformedLogError as error:
        if isinstance(error.__cause__, MemoryError):
            raise error.__cause__ from None
        raise
    assert isinstance(log, DriveLog)
    assert all(abs(lat) <= 90 for lat in log.fix.lat_deg[:100].tolist())


def main(name: str, seed: int, seconds: float) -> None:
    """Read inputs from this seed on."""
    samples, read = READERS[name]()
    path = Path(tempfile.mkdtemp()) / "input"
    for sample in samples.values():  # what is loaded and compiled is there before memory is bounded
        with suppress(FusionError):
            read(sample, path)
    used = int(re.search(r"VmSize:\s+(\d+)", Path("/proc/self/status").read_text())[1]) * 1024  # type: ignore[index]
    resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY_BYTES,) * 2)
    contents, deadline = list(samples.values()), time.monotonic() + seconds
    while time.monotonic() < deadline:
        rng = random.Random(seed)  # noqa: S311 - not for secrets
        data = mutated(rng, rng.choice(contents), contents)
        sys.stdout.write(f"{seed}\n")
        sys.stdout.flush()
        signal.setitimer(signal.ITIMER_PROF, CPU_S)
        signal.setitimer(signal.ITIMER_REAL, WALL_S)
        try:
            read(data, path)
        except FusionError as error:
            assert str(error).endswith((".", ":")), str(error)
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.setitimer(signal.ITIMER_REAL, 0)
        seed += 1


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), float(sys.argv[3]))
