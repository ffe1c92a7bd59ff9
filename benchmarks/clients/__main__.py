"""Whether clients that nobody here wrote read all of a real map, and whether they get what SQL gets.

    PYTHONPATH=.:benchmarks python -m clients MAP.osm.pbf [--maplibre FOLDER] [--only NAME ...] [--json FILE]

A service on the roads of MAP, of which nine in ten ways have slopes, is read by each client to the last segment: by
GDAL's OAPIF driver (``ogr2ogr``, and the GDAL inside pyogrio), OWSLib, QGIS without a screen, GDAL's MVT driver, and
MapLibre on ``/style.json`` in Chromium without a screen. For each the table says how many segments it got, whether a
checksum over all that it knows of each (ids, properties, ends of lines; from tiles what tiles carry) equals that of
SQL, of which properties it declares another kind than the contract, and how long it took. In the browser, a word on the
console, a request to another host, or a segment that is in a tile and not drawn is a failure.

A client that is not installed is left out with the reason. On Debian: ``apt-get install gdal-bin python3-qgis
chromium``. MapLibre is taken from FOLDER: ``npm install maplibre-gl`` in an empty folder, then its
``node_modules/maplibre-gl/dist``. Aims: all equal, and ``ogr2ogr`` of Heidelberg (141,793 segments) within 20 s. The
exit status is 1 where one is unequal.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import asdict
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from shutil import which

from accuracy.scoring import show_progress, write_json
from clients import features, vector_tiles
from clients.scene import scene
from clients.truth import Comparison, Reading, Truth

Client = Callable[[str, Path], Reading]


def clients(maplibre: Path | None) -> dict[str, tuple[Client | None, str]]:
    """Each client, or why it is left out."""
    qgis = Path("/usr/lib/python3/dist-packages/qgis")
    library = maplibre is not None and (maplibre / "maplibre-gl.mjs").is_file()
    browser: Client | None = None
    if maplibre is not None and library:
        browser = partial(vector_tiles.in_browser, maplibre=maplibre)

    def known(client: Client | None, there: object, reason: str) -> tuple[Client | None, str]:
        return (client, "") if there else (None, reason)

    no_gdal = "ogr2ogr is not installed"
    return {
        "ogr2ogr": known(partial(features.ogr2ogr, options=features.PAGED), which("ogr2ogr"), no_gdal),
        "ogr2ogr, plain": known(features.ogr2ogr, which("ogr2ogr"), no_gdal),
        "pyogrio OAPIF": (features.in_pyogrio, ""),
        "OWSLib": known(features.owslib, find_spec("owslib"), "owslib is not installed"),
        "QGIS": known(features.qgis, qgis.is_dir(), "python3-qgis is not installed"),
        "GDAL MVT": (vector_tiles.in_gdal, ""),
        "MapLibre": known(browser, library and which("chromium"), "needs chromium and --maplibre"),
    }


def main() -> None:
    """Start the service, let each client read, print the table, write JSON."""
    chosen = _arguments()
    comparisons: list[Comparison] = []
    left_out: dict[str, str] = {}
    with scene(chosen.map) as here:
        truth = Truth(here.database_url)
        print(f"{chosen.map.name}: {len(truth):,} segments by SQL")
        for name, (client, reason) in clients(chosen.maplibre).items():
            if chosen.only and name not in chosen.only:
                continue
            if client is None:
                left_out[name] = reason
                continue
            show_progress(name)
            comparisons.append(_judged(name, client, here.address, truth))
    show_progress("")
    _print(comparisons, left_out)
    write_json(
        chosen.json,
        {"segments": len(truth), "clients": [asdict(v) for v in comparisons], "left_out": left_out},
    )
    sys.exit(any(not comparison.equal or comparison.wrong_kinds for comparison in comparisons))


def _judged(name: str, client: Client, address: str, truth: Truth) -> Comparison:
    began = time.perf_counter()
    with tempfile.TemporaryDirectory(prefix="versant-client-") as folder:
        try:
            reading = features.complete(client, address, Path(folder))
            comparison = truth.judged(name, reading)
        except Exception as error:
            took = time.perf_counter() - began
            return Comparison(name, "", 0, False, "", {}, took, f"{type(error).__name__}: {error}"[:400])
    if not comparison.equal:
        print(f"{name}: {truth.difference(reading)}")
    return comparison


def _print(comparisons: list[Comparison], left_out: dict[str, str]) -> None:
    print(
        f"{'client':<14} {'version':<22} {'segments':>9} {'equal':>6} {'kinds':>6} {'seconds':>8}  checksum"
    )
    for one in comparisons:
        equal, kinds = ("yes" if good else "NO" for good in (one.equal, not one.wrong_kinds))
        print(
            f"{one.client:<14} {one.version:<22} {one.features:>9,} {equal:>6} {kinds:>6} {one.seconds:>8.1f}  "
            f"{one.checksum}  {one.remarks}{one.wrong_kinds or ''}"
        )
    for name, reason in left_out.items():
        print(f"{name:<14} left out: {reason}")


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="clients", description=(__doc__ or "").split("\n", 1)[0], epilog=(__doc__ or "").split("\n\n", 2)[2],
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
    parser.add_argument("map", type=Path, help="road map: .osm.pbf, .osm or .osm.gz")
    parser.add_argument("--maplibre", type=Path, help="folder with maplibre-gl.mjs")
    parser.add_argument("--only", nargs="+", choices=list(clients(None)), help="some of the clients")
    parser.add_argument("--json", type=Path, help="also write the figures to this file")
    return parser.parse_args()


if __name__ == "__main__":
    main()
