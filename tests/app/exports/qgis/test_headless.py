"""Each algorithm of the plug-in in Debian's QGIS, without windows, against a running service."""

from __future__ import annotations

import io
import json
import os
import subprocess
import tempfile
import threading
import zipfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
from PIL import Image
from sqlalchemy import text

from access_support import asking_for_keys
from app.core.version import code_version
from app.map.style.scale import COLOURS
from processing_support import HEADER, process_drive
from source_tree import REPOSITORY
from web_fixtures import SOUTH, STEP, WEST, Web, add_drive, fill_roads

PYTHON = "/usr/bin/python3"
"""Debian's, for which PyQGIS is built."""
RUNNER = REPOSITORY / "tests/support/qgis_runner.py"
BIG = 2**53 + 1
"""The first whole number that no double holds."""
_BIG_NUMBERS = "UPDATE segments SET from_node = from_node + 3000000000, osm_way_id = osm_way_id + :n"
_HEIGHTS = (
    "UPDATE segment_slopes SET height_from_m = 100, height_to_m = 106, height_sigma_m = 0.5 WHERE drives > 0"
)
EVERYWHERE = "-180,180,-90,90 [EPSG:4326]"
EXACT = ["osm_way_id", "from_node", "to_node", "length_m", "highway", "name", "oneway", "bridge", "drives"]
"""Properties that come as they are stored."""
Run = Callable[..., dict[str, Any]]


@cache
def has_qgis() -> bool:
    """Whether Debian's Python finds QGIS; asked once, since that takes a second."""
    asked = subprocess.run(
        [PYTHON, "-c", "import qgis.core"],
        capture_output=True,
        check=False,
        env={"QT_QPA_PLATFORM": "offscreen"},
    )
    return asked.returncode == 0


@pytest.fixture
def qgis(tmp_path: Path) -> Run:
    """``qgis(base, runs, key=, logins=)``: QGIS with the plug-in that the service offers."""
    if not Path(PYTHON).exists() or not has_qgis():
        pytest.skip("QGIS is not here: `.ci/prepare qgis` installs it on Debian")

    def run(
        base: str, *runs: dict[str, Any], key: str = "", logins: Any = None, locale: str = "C.UTF-8"
    ) -> dict[str, Any]:
        home = Path(tempfile.mkdtemp(dir=tmp_path))  # nobody was here before
        with zipfile.ZipFile(
            io.BytesIO(httpx.get(f"{base}/qgis/versant.zip", trust_env=False).content)
        ) as one:
            one.extractall(tmp_path / "plugins")
        environment = {
            "PATH": os.environ["PATH"],
            "HOME": str(home),
            "QGIS_AUTH_DB_DIR_PATH": str(home),
            "QT_QPA_PLATFORM": "offscreen",
            "LC_ALL": locale,
            **({"VERSANT_KEY": key} if key else {}),
        }
        done = subprocess.run(
            [PYTHON, str(RUNNER), str(tmp_path / "plugins")],
            input=json.dumps(
                {"runs": runs, "logins": logins or {}, "repository": f"{base}/qgis/plugins.xml"}
            ),
            capture_output=True,
            text=True,
            env=environment,
            timeout=120,
            check=False,
        )
        assert done.returncode == 0, done.stderr[-3000:]
        return dict(json.loads(done.stdout.splitlines()[-1]))

    return run


@pytest.fixture
def big(web: Web) -> Web:
    """The grid with numbers that no double holds, three segments driven, heights along the first street."""
    with web.sessions.begin() as session:
        session.execute(text(f"ALTER SEQUENCE segments_id_seq RESTART WITH {BIG}"))
    fill_roads(web.sessions)
    add_drive(web.sessions, [0, 1, 2], 3.5)
    with web.sessions.begin() as session:
        session.execute(text(_BIG_NUMBERS), {"n": BIG})
        session.execute(text(_HEIGHTS))
    return web


def test_slopes_of_an_area_come_whole_with_their_types_and_are_drawn(
    big: Web, qgis: Run, tmp_path: Path
) -> None:
    area = f"{WEST},{WEST + 0.001},{SOUTH},{SOUTH + 3.5 * STEP} [EPSG:4326]"
    answer = qgis(
        big.base,
        {"algorithm": "slopes", "parameters": {"SERVER": big.base, "EXTENT": EVERYWHERE, "DRIVEN": False}},
        {"algorithm": "slopes", "parameters": {"EXTENT": area}, "draw": str(tmp_path / "map.png")},
        {"algorithm": "slopes", "parameters": {"EXTENT": EVERYWHERE, "FILE": str(tmp_path / "slopes.gpkg")}},
        {"algorithm": "slopes", "parameters": {"EXTENT": EVERYWHERE, "DRIVEN": False}, "cancel": True},
    )  # fmt: skip
    assert answer["metadata"]["hasProcessingProvider"] == "yes"
    offered = {"id": "versant", "name": "Versant", "version_available": code_version(), "error": ""}
    assert answer["offered"] == offered | {"download_url": f"{big.base}/qgis/versant.zip"}
    assert answer["algorithms"] == ["versant:profile", "versant:slopes", "versant:upload"]
    assert answer["kept_server"] == big.base, "it worked, so it is the next form's"
    assert not answer["left"]
    everything, driven, file, cancelled = answer["runs"]
    assert [one["errors"] for one in answer["runs"]] == [[]] * 4
    assert len(cancelled["layer"]["rows"]) == big.settings.items_limit_max, "no page more was asked for"

    rows = {row["id"]: row for row in everything["layer"]["rows"]}
    truth = stored(big)
    assert len(rows) == len(truth) > 2 * big.settings.items_limit_max, "several pages"
    assert {n: {name: row[name] for name in EXACT} for n, row in rows.items()} == truth
    assert min(truth) == BIG
    types = everything["layer"]["types"]
    assert {types[name] for name in ("id", "osm_way_id", "from_node", "to_node", "drives")} == {"qlonglong"}
    assert {types[name] for name in ("slope_percent", "slope_sigma_percent", "length_m")} == {"double"}
    assert (types["bridge"], types["updated_at"], types["name"]) == ("bool", "QDateTime", "QString")
    assert everything["layer"]["crs"] == "EPSG:4326"
    assert "OpenStreetMap" in everything["layer"]["rights"][0]

    shown = driven["layer"]
    assert [row["slope_percent"] for row in shown["rows"]] == [3.5] * 3
    assert all(row["updated_at"].startswith("20") for row in shown["rows"])
    assert rows[BIG + 5]["slope_percent"] is None, "unknown is not 0"
    assert shown["rows"][0]["wkt"] == f"LineString ({WEST:g} {SOUTH:g}, {WEST:g} {SOUTH + STEP:g})"
    assert shown["renderer"] == "graduatedSymbol"
    colour = tuple(int(COLOURS[3][k : k + 2], 16) for k in (1, 3, 5))
    pixels = np.asarray(Image.open(tmp_path / "map.png").convert("RGB")).reshape(-1, 3)
    assert np.count_nonzero((pixels == colour).all(axis=1)) > 500, "3.5 % has the fourth colour"
    assert {row["id"] for row in file["layer"]["rows"]} == {BIG, BIG + 1, BIG + 2}
    assert file["layer"]["types"]["id"] == "qlonglong"


def stored(web: Web) -> dict[int, dict[str, Any]]:
    """What the database says of each segment."""
    query = """
        SELECT id, osm_way_id, from_node, to_node, round(length_m::numeric, 3)::float8, highway, name, oneway, bridge,
            coalesce(drives, 0)
        FROM segments LEFT JOIN segment_slopes ON segment_id = id
    """
    with web.sessions() as session:
        return {row[0]: dict(zip(EXACT, row[1:], strict=True)) for row in session.execute(text(query))}


def test_a_profile_runs_along_each_part_of_each_line(big: Web, qgis: Run) -> None:
    up = f"LineString ({WEST} {SOUTH}, {WEST} {SOUTH + STEP})"
    down = f"MultiLineString (({WEST} {SOUTH + STEP}, {WEST} {SOUTH}), (0 0, 0 0.0005))"
    north = np.arcsinh(np.tan(np.radians([SOUTH, SOUTH + STEP])))
    x, *y = (6_378_137 * one for one in (np.radians(WEST), *north))
    mercator = f"LineString ({x} {y[0]}, {x} {y[1]})"
    lines = {"lines": [up, down], "crs": "EPSG:4326"}
    other = {"lines": [mercator], "crs": "EPSG:3857"}
    asked = {"SERVER": big.base, "STEP": 20.0}
    answer = qgis(
        big.base,
        {"algorithm": "profile", "parameters": asked | {"LINES": lines}},
        {"algorithm": "profile", "parameters": asked | {"LINES": other}},
    )
    both, turned = answer["runs"]
    assert both["errors"] == turned["errors"] == []
    rows = both["layer"]["rows"]
    assert both["layer"]["types"] == {
        "line": "qlonglong", "part": "int", "source": "QString",
        **dict.fromkeys(("distance_m", "height_m", "sigma", "slope_percent", "slope_sigma_percent"), "double"),
    }  # fmt: skip
    first = [row for row in rows if row["line"] == 1]
    assert [row["distance_m"] for row in first][:2] == [0.0, pytest.approx(20, abs=1)]
    assert first[0]["height_m"] == pytest.approx(100, abs=0.1)
    assert first[-1]["height_m"] == pytest.approx(106, abs=0.1)
    middle = first[len(first) // 2]
    assert middle["slope_percent"] == pytest.approx(100 * 6 / 222.4, abs=0.2)
    assert middle["source"] == "measured"
    back = [row for row in rows if (row["line"], row["part"]) == (2, 1)]
    assert back[len(back) // 2]["slope_percent"] == pytest.approx(-middle["slope_percent"], abs=0.01)
    sea = [row for row in rows if (row["line"], row["part"]) == (2, 2)]
    assert len(sea) > 2
    assert {row["height_m"] for row in sea} == {None}
    assert any("m up" in said for said in both["said"])
    assert turned["layer"]["rows"][0]["height_m"] == pytest.approx(100, abs=0.1)


def drive_north(lat: float, lon: float, begin_s: int) -> bytes:
    """A minute's log."""
    rows = (b"%d,%.7f,%.7f\n" % (begin_s + k, lat + 0.0001 * k, lon) for k in range(60))
    return HEADER + b"".join(rows)


def test_drives_are_uploaded_and_followed(web: Web, qgis: Run, tmp_path: Path) -> None:
    fill_roads(web.sessions)
    log, far, nonsense = tmp_path / "straße & hügel.csv", tmp_path / "far.csv", tmp_path / "notes.txt"
    log.write_bytes(drive_north(SOUTH, WEST, 1_700_000_000))
    far.write_bytes(drive_north(10, 10, 1_700_009_000))
    nonsense.write_text("no log")
    done = threading.Event()

    def work() -> None:
        """The worker's part: whatever waits is computed, until the plug-in has seen it."""
        while not done.wait(0.1):
            with web.sessions() as session:
                waiting = session.execute(
                    text("SELECT id, generation FROM drives WHERE status = 'queued'")
                ).all()
            for drive_id, generation in waiting:
                process_drive(web.context, drive_id, generation)

    worker = threading.Thread(target=work)
    worker.start()
    try:
        parameters = {"SERVER": web.base, "FILES": [str(one) for one in (log, far, nonsense)], "WAIT": True}
        again = {"SERVER": web.base, "FILES": [str(log)]}
        answer = qgis(
            web.base,
            {"algorithm": "upload", "parameters": parameters},
            {"algorithm": "upload", "parameters": again},
        )
    finally:
        done.set()
        worker.join()
    first, second = answer["runs"]
    rows = {row["file"]: row for row in first["layer"]["rows"]}
    drives = {one["filename"]: one for one in web.client.get("/v1/drives").json()["drives"]}
    assert set(rows) == {log.name, far.name, nonsense.name}
    assert {name: rows[name]["drive"] for name in drives} == {name: one["id"] for name, one in drives.items()}
    assert {name: rows[name]["status"] for name in drives} == {
        name: one["status"] for name, one in drives.items()
    }
    assert rows[log.name]["reason"] == (drives[log.name]["failure"] or {}).get("reason")
    reason = drives[far.name]["failure"]["reason"]
    assert (rows[far.name]["status"], rows[far.name]["reason"]) == ("failed", reason)
    assert rows[nonsense.name]["drive"] is None
    assert rows[nonsense.name]["status"] == "not sent"
    assert rows[nonsense.name]["reason"] in "\n".join(first["errors"])
    assert first["results"]["DRIVES"] == ",".join(rows[one.name]["drive"] for one in (log, far))
    assert [row["drive"] for row in second["layer"]["rows"]] == [rows[log.name]["drive"]]


def test_a_service_that_wants_a_key_gets_it_and_refuses_in_its_own_words(settings: Any, qgis: Run) -> None:
    with asking_for_keys(settings, public_map="off") as keyed:
        base, secret = keyed.web.base, keyed.secrets["anna"]
        fill_roads(keyed.web.sessions)
        asked = {"SERVER": base, "EXTENT": "8,9,48,50 [EPSG:4326]", "DRIVEN": False}
        logins = {"LOGIN": ["anybody", secret], "WRONG": ["anybody", keyed.secrets["wrong"]]}
        bare = qgis(
            base,
            {"algorithm": "slopes", "parameters": asked},
            {"algorithm": "slopes", "parameters": asked | {"AUTHCFG": "LOGIN"}},
            {"algorithm": "slopes", "parameters": asked | {"AUTHCFG": "WRONG"}},
            {"algorithm": "slopes", "parameters": asked | {"SERVER": "http://127.0.0.1:9"}},
            {"algorithm": "slopes", "parameters": asked | {"SERVER": "slopes.example"}},
            logins=logins,
        )
        nothing, login, wrong, nobody, no_address = bare["runs"]
        sentence = keyed.web.client.get("/collections/segments/items").json()["detail"]
        assert (nothing["done"], nothing["errors"]) == (False, [sentence])
        assert (login["done"], len(login["layer"]["rows"]) > 100) == (True, True)
        assert not wrong["done"]
        assert wrong["errors"] == [keyed.ask("wrong", "GET", "/collections/segments/items").json()["detail"]]
        assert nobody["errors"][0].startswith("http://127.0.0.1:9 does not answer: ")
        assert no_address["errors"] == [
            "The address of the service is not one: slopes.example. It begins with http:// or https://."
        ]
        by_environment, german = qgis(
            base,
            {"algorithm": "slopes", "parameters": asked},
            {"algorithm": "slopes", "parameters": asked | {"SERVER": "slopes.example"}},
            key=secret,
            locale="de_DE.UTF-8",
        )["runs"]
        assert german["errors"][0].startswith("Die Adresse des Dienstes ist keine: slopes.example.")
        assert len(by_environment["layer"]["rows"]) == len(login["layer"]["rows"])
