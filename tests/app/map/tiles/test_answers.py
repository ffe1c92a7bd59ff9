"""Vector tiles over HTTP: what is compressed, what caches are told, and what holds as on every other way."""

from __future__ import annotations

import zlib
from collections.abc import Callable
from typing import Any, cast

import httpx
import pytest
from sqlalchemy import create_engine, text

from app.core.settings import Settings
from app.map.tiles.front import parse_path, takes_gzip
from app.map.tiles.store import Address
from mvt_support import layers
from problem_support import check
from server_support import asked_at_once, wait_until

TILE = "/tiles/13/4287/2813.mvt"
QUICK_AND_NOT = pytest.mark.parametrize("query", ["", "?v=2"])
"""On the quick way, and through the route."""


class RawResponse(httpx.Response):
    """An answer with its body as it was sent."""

    sent: bytes


def raw(web: Any, path: str, method: str = "GET", **headers: str) -> RawResponse:
    """The answer with its body as it was sent."""
    named = {name.replace("_", "-"): value for name, value in headers.items()}
    with web.client.stream(method, path, headers={"Accept-Encoding": "identity", **named}) as answer:
        answer.sent = b"".join(answer.iter_raw())
        return cast(RawResponse, answer)


@QUICK_AND_NOT
def test_a_tile_is_sent_as_it_is_kept_to_who_takes_that(reading: Any, query: str) -> None:
    packed = raw(reading, TILE + query, Accept_Encoding="br, gzip;q=0.5")
    plain = raw(reading, TILE + query)
    assert packed.headers["content-encoding"] == "gzip"
    assert "content-encoding" not in plain.headers
    assert zlib.decompress(packed.sent, wbits=31) == plain.sent
    assert layers(plain.sent)["segments"]
    for answer in (packed, plain):
        assert answer.headers["content-length"] == str(len(answer.sent))
        assert answer.headers["content-type"] == "application/vnd.mapbox-vector-tile"
        assert "accept-encoding" in answer.headers["vary"].lower()
    assert packed.headers["etag"] == plain.headers["etag"]


@pytest.mark.parametrize(
    ("header", "takes"),
    [
        ("gzip", True),
        ("GZIP", True),
        ("br;q=1.0, gzip;q=0.8", True),
        ("*", True),
        ("gzip;q=0", False),
        ("gzip; q=0.000, *", False),
        ("*;q=0", False),
        ("identity", False),
        ("", False),
        ("x-gzip-not", False),
    ],
)
def test_who_takes_gzip(header: str, takes: bool) -> None:
    assert takes_gzip(header) == takes


@QUICK_AND_NOT
@pytest.mark.parametrize("path", [TILE, "/tiles/14/0/0.mvt", TILE.replace("mvt", "pbf")])
def test_head_is_get_without_a_body(reading: Any, path: str, query: str) -> None:
    get, head = raw(reading, path + query), raw(reading, path + query, "HEAD")
    assert head.status_code == get.status_code
    assert head.sent == b""
    for name in ("etag", "content-length", "content-type", "cache-control", "vary"):
        assert head.headers.get(name) == get.headers.get(name), name


@QUICK_AND_NOT
def test_who_has_it_is_told_so(reading: Any, query: str) -> None:
    etag = reading.client.get(TILE).headers["etag"]
    for known in (etag, etag.removeprefix("W/"), f'"x", {etag}', "*"):
        answer = raw(reading, TILE + query, If_None_Match=known)
        assert (answer.status_code, answer.sent) == (304, b"")
        assert answer.headers["etag"] == etag
        assert answer.headers["cache-control"] == "public, no-cache"
    for known in ('"x"', etag[:-2] + '9"', ""):
        assert raw(reading, TILE + query, If_None_Match=known).status_code == 200


def test_a_cache_in_front_may_be_given_time(settings: Settings, server_maker: Callable[..., Any]) -> None:
    for given, said in ((0, "public, no-cache"), (60, "public, max-age=60, stale-while-revalidate=300")):
        chosen = settings.model_copy(update={"tile_max_age_s": given, "tile_stale_s": 300})
        with server_maker(chosen) as web:
            for path in ("/tiles/14/0/0.mvt", "/tiles/14/0/0.mvt?x=1"):
                answer = web.client.get(path)
                assert answer.headers["cache-control"] == said
                again = web.client.get(path, headers={"If-None-Match": answer.headers["etag"]})
                assert (again.status_code, again.headers["cache-control"]) == (304, said)


def test_requests_are_counted_by_their_route(reading: Any) -> None:
    def counted(method: str, route: str, status: int) -> float:
        wanted = f'versant_http_requests_total{{method="{method}",route="{route}",status="{status}"}}'
        lines = reading.client.get("/metrics").text.splitlines()
        return sum(float(line.split()[-1]) for line in lines if line.startswith(wanted))

    template = "/collections/{collection}/tiles/WebMercatorQuad/{tileMatrix}/{tileRow}/{tileCol}"
    for path, route in (
        (TILE, "/tiles/{z}/{x}/{y}.mvt"),
        (TILE + "?v=1", "/tiles/{z}/{x}/{y}.mvt"),
        ("/collections/segments/tiles/WebMercatorQuad/13/2813/4287", template),
        ("/collections/segments/tiles/WebMercatorQuad/13/2813/4287?f=mvt", template),
    ):
        before = counted("GET", route, 200)
        assert reading.client.get(path).headers["x-request-id"]
        assert counted("GET", route, 200) == before + 1


@QUICK_AND_NOT
def test_a_host_that_is_not_the_service_gets_no_tile(reading: Any, query: str) -> None:
    check(reading.client.get(TILE + query, headers={"Host": "rebound.example"}), 421)


def test_a_place_in_a_lane_is_taken_once(reading: Any) -> None:
    """More than the lane has places for, on the way through the route; each with its place waits for nothing else."""
    paths = [f"/tiles/11/{x}/7.mvt?v=1" for x in range(12)] + [
        f"/tiles/WebMercatorQuad/11/8/{x}?f=mvt" for x in range(12)
    ]
    with asked_at_once(reading, paths) as answers:
        assert {one.result(timeout=8) for one in answers} == {204}


def test_a_request_with_a_body_is_answered_too(reading: Any) -> None:
    assert reading.client.request("GET", TILE, content=b"x").content == reading.client.get(TILE).content


@pytest.mark.parametrize(
    "path",
    [
        "/tiles/19/0/0.mvt",
        "/tiles/31/0/0.pbf",
        "/tiles/13/8192/0.mvt",
        "/tiles/13/0/8192.pbf",
        "/tiles/013/0/0.mvt",
        "/tiles/1e1/0/0.mvt",
        "/tiles/13/4287/2813.png",
        "/tiles/-1/0/0.mvt",
        "/tiles/13/99999999999/0.mvt",
        "/tiles/\u0663/0/0.mvt",
        "/collections/roads/tiles/WebMercatorQuad/13/2813/4287",
        "/tiles/13/4287/2813.mvt/",
    ],
)
def test_the_quick_way_takes_only_what_is_a_tile_beyond_doubt(path: str) -> None:
    assert parse_path(path, 18) is None


def test_the_row_is_before_the_column_where_the_standard_has_it_so() -> None:
    wanted = Address("segments", 13, 4287, 2813)
    for path in (
        "/tiles/13/4287/2813.mvt",
        "/tiles/13/4287/2813.pbf",
        "/tiles/WebMercatorQuad/13/2813/4287",
        "/tiles/WebMercatorQuad/13/2813/4287.mvt",
        "/collections/segments/tiles/WebMercatorQuad/13/2813/4287.pbf",
    ):
        asked = parse_path(path, 18)
        assert asked is not None
        assert asked.at == wanted
    ways = parse_path("/collections/ways/tiles/WebMercatorQuad/13/2813/4287", 18)
    assert ways is not None
    assert ways.at == wanted._replace(layer="ways")


def test_a_database_that_is_away_is_a_503_until_it_is_back(filled: Any) -> None:
    url = str(filled.settings.database_url)
    name = url.split("?", maxsplit=1)[0].rsplit("/", 1)[1]
    etag = filled.client.get(TILE).headers["etag"]
    server = create_engine(url.replace(f"/{name}?", "/postgres?"), isolation_level="AUTOCOMMIT")
    ended = text("SELECT pg_terminate_backend(pid) FROM pg_stat_activity WHERE datname = :name")
    with server.connect() as connection:
        connection.execute(ended, {"name": name}).all()  # a restarted server costs no request
        assert filled.client.get(TILE, headers={"If-None-Match": etag}).status_code == 304
        connection.execute(text(f'ALTER DATABASE "{name}" WITH ALLOW_CONNECTIONS false'))
        try:
            connection.execute(ended, {"name": name}).all()
            for path in (TILE, TILE + "?v=1", TILE.replace("4287", "4288")):
                answer = filled.client.get(path)
                assert check(answer, 503)["type"] == "/problems/database-unavailable"
                assert answer.headers["retry-after"]
        finally:
            connection.execute(text(f'ALTER DATABASE "{name}" WITH ALLOW_CONNECTIONS true'))
        wait_until(lambda: filled.client.get(TILE, headers={"If-None-Match": etag}).status_code == 304)
        assert filled.client.get(TILE).status_code == 200
    server.dispose()
