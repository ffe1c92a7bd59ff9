"""Operations over HTTP and in a worker: planned, approved, carried out, cancelled, refused with a sentence."""

from __future__ import annotations

import uuid
from collections.abc import Callable
from pathlib import Path
from typing import Any

import httpx
import pytest
from sqlalchemy import text

from app.core.blobs import IMPORTS
from fusion.simulate.scene.town import Town
from fusion.simulate.write.dem_file import write_dem
from fusion.simulate.write.osm_file import write_osm
from problem_support import check
from web_fixtures import Web, add_drive

Work = Callable[..., list[str]]


@pytest.fixture(scope="module")
def ground(town: Town, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a town's roads and its elevation."""
    folder = tmp_path_factory.mktemp("ground")
    write_osm(town, folder / "town.osm")
    write_dem(town, folder / "town.tif")
    return folder


def ask(web: Web, file: Path | None = None, status: int = 202, **query: Any) -> dict[str, Any]:
    files = None if file is None else {"file": (file.name, file.read_bytes())}
    answer = web.client.post("/v1/operations", params=query, files=files)
    assert answer.status_code == status, answer.text
    found: dict[str, Any] = answer.json()
    if status < 300:
        assert answer.headers["location"] == f"{web.base}/v1/operations/{found['id']}"
    return found


def seen(web: Web, operation: dict[str, Any]) -> dict[str, Any]:
    found: dict[str, Any] = web.client.get(f"/v1/operations/{operation['id']}").json()
    return found


def approve(web: Web, operation: dict[str, Any]) -> httpx.Response:
    return web.client.post(f"/v1/operations/{operation['id']}/approve")


def drop(web: Web, operation: dict[str, Any]) -> httpx.Response:
    return web.client.delete(f"/v1/operations/{operation['id']}")


def files(web: Web) -> list[str]:
    return web.context.part(IMPORTS).keys()


def regions(web: Web) -> dict[str, int]:
    return {one["name"]: one["segments"] for one in web.client.get("/v1/regions").json()["regions"]}


def audited(web: Web) -> list[str]:
    return [row["action"] for row in reversed(web.client.get("/v1/admin/audit").json()["rows"])]


def test_roads_are_planned_then_imported_and_the_region_removed_again(
    web: Web, ground: Path, work: Work
) -> None:
    operation = ask(web, ground / "town.osm", kind="import-roads", region="here")
    assert (operation["status"], operation["subject"]) == ("queued", "town.osm")
    check(approve(web, operation), 409)
    assert work(web) == ["planned"]
    planned = seen(web, operation)
    assert planned["plan"]["added"] > 10
    assert planned["plan"]["sentence"].startswith("Region here would have")
    assert {one["rel"] for one in planned["links"]} == {"self", "edit"}
    assert regions(web) == {}
    for _ in range(2):  # once more changes nothing
        assert approve(web, operation).json()["status"] == "queued"
    assert work(web) == ["done"]
    done = seen(web, operation)
    assert done["status"] == "done"
    assert done["result"]["sentence"].startswith("Region here has")
    assert regions(web) == {"here": planned["plan"]["added"]}
    assert files(web) == []
    assert approve(web, operation).json()["status"] == "done"
    check(drop(web, operation), 422)

    removal = ask(web, kind="remove-region", name="here")
    assert work(web) == ["planned"]
    assert seen(web, removal)["plan"]["dropped"] == planned["plan"]["added"]
    approve(web, removal)
    assert work(web) == ["done"]
    assert regions(web) == {}
    assert audited(web) == [
        "import-roads asked for",
        "import-roads approved",
        "remove-region asked for",
        "remove-region approved",
    ]


def test_what_was_approved_is_done_and_nothing_else(filled: Web, ground: Path, work: Work) -> None:
    """The map changes between the plan and its approval, then more is lost than was said."""
    removal = ask(filled, kind="remove-region", name="roads")
    work(filled)
    add_drive(filled.sessions, [0, 1, 2])
    approve(filled, removal)
    assert work(filled) == ["planned"]
    again = seen(filled, removal)
    assert again["status"] == "planned"
    assert again["plan"]["sentence"].startswith(
        "The map has changed since this was approved, so nothing was done."
    )
    assert again["plan"]["measured_lost"] == 3
    assert regions(filled) == {"roads": 115}
    approve(filled, removal)
    assert work(filled) == ["done"]
    assert regions(filled) == {}


def test_a_raster_is_imported_and_removed(web: Web, ground: Path, work: Work) -> None:
    for kind in ("import-roads", "import-dem"):
        name = {"import-roads": "town.osm", "import-dem": "town.tif"}[kind]
        said = {"source": "Town <survey>", "licence": "CC0"} if kind == "import-dem" else {}
        operation = ask(web, ground / name, kind=kind, **said)
        work(web)
        if kind == "import-roads":
            approve(web, operation)
            work(web)
    done = seen(web, operation)
    assert (done["status"], done["plan"]) == ("done", None)
    assert done["result"]["rasters"] == 1
    (raster,) = web.client.get("/v1/rasters").json()["rasters"]
    assert [raster[name] for name in ("name", "source", "licence")] == ["town.tif", "Town <survey>", "CC0"]
    tiles = web.client.get("/tiles.json").json()
    assert tiles["attribution"].endswith("elevation from Town &lt;survey&gt; (CC0)")
    assert tiles["versant:elevation"] == [
        {"credit": "Town <survey> (CC0)", "boxes": [pytest.approx(raster["bbox"], abs=1e-4)]}
    ]
    removal = ask(web, kind="remove-raster", name="TOWN.tif")
    work(web)
    plan = seen(web, removal)["plan"]
    assert plan["segments"] > 0
    assert plan["rasters_left"] == 0
    approve(web, removal)
    assert work(web) == ["done"]
    assert web.client.get("/v1/rasters").json()["rasters"] == []
    with web.sessions() as session:
        known = "SELECT count(*) FROM segments WHERE dem_slope_percent IS NOT NULL"
        assert session.execute(text(known)).scalar_one() == 0


def test_the_map_is_settled(filled: Web, work: Work) -> None:
    add_drive(filled.sessions, [0, 1, 2])
    first = ask(filled, kind="settle")
    assert ask(filled, kind="settle")["id"] == first["id"]
    assert work(filled) == ["done"]
    assert seen(filled, first)["result"]["sentence"].endswith("solved anew.")


def test_widenings_are_learned_and_reset(filled: Web, work: Work) -> None:
    for kind in ("learn-widenings", "reset-widenings"):
        operation = ask(filled, kind=kind)
        assert work(filled) == ["done"]
        assert "taken at their word" in seen(filled, operation)["result"]["sentence"]


def test_what_cannot_be_asked_for_is_said_and_leaves_nothing(web: Web, ground: Path, tmp_path: Path) -> None:
    empty = tmp_path / "empty.osm"
    empty.touch()
    assert "no file" in check(web.client.post("/v1/operations?kind=import-roads"), 422)["detail"]
    check(web.client.post("/v1/operations?kind=import-roads", files={"file": ("x.osm", b"")}), 422)
    check(web.client.post("/v1/operations?kind=import-roads", content=b"abc"), 422)  # no name
    check(web.client.post("/v1/operations?kind=import-roads", files={"other": ("x.osm", b"x")}), 422)
    several = [("file", ("a.osm", b"a")), ("file", ("b.osm", b"b"))]
    assert (
        "one file" in check(web.client.post("/v1/operations?kind=import-dem", files=several), 422)["detail"]
    )
    for query in (
        "kind=nonsense",
        "",
        "kind=remove-region",
        "kind=remove-region&name=nowhere",
        "kind=remove-raster&name=nothing.tif",
        "kind=settle&region=x",
        "kind=import-dem&priority=x",
        "kind=import-dem&priority=99999999999",
        "kind=import-roads&region=a/b",
        "kind=settle&nonsense=1",
    ):
        check(web.client.post(f"/v1/operations?{query}", files={"file": ("x.osm", b"x")}), 422)
    check(web.client.get("/v1/operations?limit=0"), 422)
    check(web.client.get("/v1/operations?after=x"), 422)
    for path in ("", "/approve"):
        method = "POST" if path else "GET"
        check(web.client.request(method, f"/v1/operations/{uuid.uuid4()}{path}"), 404)
    check(web.client.delete(f"/v1/operations/{uuid.uuid4()}"), 404)
    assert web.client.get("/v1/operations").json()["operations"] == []
    assert files(web) == []
    assert audited(web) == []


@pytest.mark.parametrize(
    ("kind", "name", "content", "reason"),
    [
        ("import-roads", "x.osm.pbf", b"This is a letter.", "bad-roads"),
        ("import-roads", "x.osm", b"<osm version='0.6'></osm>", "bad-roads"),
        ("import-roads", "x.osc", b"<osmChange version='0.6'></osmChange>", "bad-roads"),
        ("import-dem", "x.tif", b"This is a letter.", "bad-terrain"),
    ],
)
def test_a_file_that_cannot_be_used_fails_with_a_sentence(
    web: Web, work: Work, kind: str, name: str, content: bytes, reason: str
) -> None:
    answer = web.client.post(f"/v1/operations?kind={kind}&filename={name}", content=content)
    assert work(web) == ["failed"]
    failed = seen(web, answer.json())
    assert failed["status"] == "failed"
    assert failed["failure"]["kind"] == reason
    assert failed["failure"]["reason"].endswith(".")
    assert str(web.settings.data_dir) not in failed["failure"]["reason"]
    assert files(web) == []
    (row,) = [
        row for row in web.client.get("/v1/admin/attention").json()["rows"] if "operation" in row["kind"]
    ]
    assert (row["severity"], row["link"]) == ("look", "/v1/operations")
    check(approve(web, failed), 422)


def test_a_file_above_the_limit_is_refused_and_has_a_limit_of_its_own(
    settings: Any, server_maker: Any, ground: Path
) -> None:
    with server_maker(settings.model_copy(update={"max_import_bytes": 300_000})) as web:
        content = b"x" * 250_000  # more than an upload or a small body may have
        answer = web.client.post("/v1/operations?kind=import-roads&filename=x.osm", content=content)
        assert answer.status_code == 202, answer.text
        check(
            web.client.post("/v1/operations?kind=import-dem", files={"file": ("x.tif", b"x" * 400_000)}), 413
        )

        def pieces() -> Any:
            yield from (b"x" * 100_000 for _ in range(5))

        check(web.client.post("/v1/operations?kind=import-dem&filename=x.tif", content=pieces()), 413)
        assert len(files(web)) == 1


def test_what_waits_or_is_planned_can_be_dropped(web: Web, ground: Path, work: Work) -> None:
    first = ask(web, ground / "town.osm", kind="import-roads")
    again = ask(web, ground / "town.osm", kind="import-roads")
    assert again["id"] == first["id"], "the same again while it waits"
    assert len(files(web)) == 1
    for _ in range(2):
        assert drop(web, first).json()["status"] == "cancelled"
    assert files(web) == []
    assert work(web) == []
    second = ask(web, ground / "town.osm", kind="import-roads")
    work(web)
    assert drop(web, second).json()["status"] == "cancelled"
    assert files(web) == []
    check(approve(web, second), 422)
    listed = web.client.get("/v1/operations?limit=1").json()
    assert [one["id"] for one in listed["operations"]] == [second["id"]]
    following = next(one["href"] for one in listed["links"] if one["rel"] == "next")
    assert [one["id"] for one in web.client.get(following).json()["operations"]] == [first["id"]]
    assert audited(web).count("import-roads cancelled") == 2
