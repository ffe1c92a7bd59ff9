"""The application: every subject's routes, and what wraps them. A new group is one module and one line here."""

from __future__ import annotations

import asyncio
import uuid
from collections.abc import AsyncIterator, Callable, Collection, Iterator, Mapping
from contextlib import asynccontextmanager, suppress
from functools import partial
from typing import Any

from anyio import CapacityLimiter
from fastapi import APIRouter, FastAPI
from fastapi.routing import APIRoute
from sqlalchemy.exc import SQLAlchemyError
from starlette.middleware import Middleware

from app.access import routes as access
from app.access import sessions, zones
from app.access.callers import Callers
from app.access.description import tell_rules
from app.access.gate import Gate
from app.access.oidc import Provider
from app.access.sessions import Logins
from app.changes import routes as changes
from app.changes.routes import Live
from app.changes.webhooks import routes as webhooks
from app.core import middleware
from app.core.admission import MORE_CONNECTIONS, Admission, RequestClass, Turnstile, make_request_classes
from app.core.blobs import BlobStore
from app.core.caller import EDITION, SERVICE, as_caller, guard
from app.core.db import Patience, Sessions, make_engine, session_factory
from app.core.disconnects import EndWithClient
from app.core.http import Service
from app.core.messages import say
from app.core.problems import Problem, install_error_handlers
from app.core.receiving.announcements import Announcements
from app.core.receiving.clients import Forwarded, Shares
from app.core.receiving.pace import Bodies
from app.core.settings import Settings, SettingsError, get_settings
from app.core.standby.use import standby_of
from app.core.telemetry.requests import RequestLog
from app.core.version import code_version
from app.drives import catalogue as methods
from app.drives import feed, resumable, upload
from app.drives import routes as drives
from app.drives.batches import removing
from app.drives.batches import routes as batches
from app.drives.documents import Drive
from app.drives.live import routes as live
from app.drives.outputs.drawing import Drawing
from app.drives.parts import columns
from app.drives.parts import routes as drive_parts
from app.drives.person import archive
from app.drives.person import routes as person
from app.drives.store import get_drives
from app.drives.trials import routes as trials
from app.exports import routes as exports
from app.exports.qgis import routes as qgis
from app.map import segments
from app.map.heights import energy
from app.map.heights import routes as heights
from app.map.items import collection_routes as collections
from app.map.items import landing
from app.map.items import routes as items
from app.map.items.routes import tell_limits
from app.map.style import routes as style
from app.map.tiles import names
from app.map.tiles import routes as tiles
from app.map.tiles.front import TileFront
from app.map.tiles.servers import MapTiles
from app.operations import routes as operations
from app.operations import sources
from app.ops import health, metrics, stats
from app.ops import problems as problem_kinds
from app.ops.admin import routes as admin
from app.releases import routes as releases
from app.releases.store import edition_note
from app.web import docs, pages

ROUTERS: tuple[APIRouter, ...] = (
    live.router,  # in front: phones ask it once a minute each, and routes are tried in their order
    sessions.router,
    access.router,
    zones.router,
    person.router,
    upload.router,
    resumable.router,
    methods.router,
    batches.router,  # before drives: its path would else be taken for a drive's
    removing.router,
    drives.router,
    feed.router,
    drive_parts.router,
    columns.router,
    trials.router,
    segments.router,
    segments.behind,
    changes.router,
    webhooks.router,
    landing.router,
    collections.router,
    items.router,
    tiles.router,
    names.router,
    heights.router,
    energy.router,
    tiles.ogc_router,
    exports.router,
    qgis.router,
    releases.router,
    sources.router,
    operations.router,
    style.router,
    stats.router,
    admin.router,  # after the figures, whose path it would else take for a query's
    health.router,
    metrics.router,
    problem_kinds.router,
    docs.router,
    pages.router,
    collections.unknown,  # after all: what no other route of collections answers
)


DESCRIPTION = f"""Versant measures the slope of roads. Upload what a vehicle recorded; read the slope of every
road segment that was driven, with its uncertainty, as GeoJSON and as tiles.

Slopes are in percent, positive uphill from `from_node` to `to_node`, the direction in which the OpenStreetMap
way is drawn; sigma is one standard deviation; unknown is null, never 0. Times are UTC. Errors are problem
documents (RFC 9457): what takes too long, or is asked for by too many at once, is answered by 503 with
`Retry-After`; a request under a host name that is not the service's by 421. {landing.BIND_NOTE}"""

TAGS = {
    "access": "Who may ask for what: logging in, keys, owners.",
    "drives": "Upload logs and look at what became of them.",
    "live": "Points of drives under way, as phones and trackers send them by themselves.",
    "segments": "One road segment, and the drives behind its slope.",
    "map": "All road segments, as OGC API Features.",
    "changes": "Following the map: what changed since a version, and being told of it.",
    "tiles": "Map tiles.",
    "heights": "Heights of the road at places, as other services give them of the ground.",
    "exports": "The map, or a part of it, as files.",
    "editions": "Editions of the map for the public, and what the service shows to whom.",
    "operation": "Health, metrics, figures and long work of operators, kinds of problems.",
}
FASTAPI_ERRORS = ("HTTPValidationError", "ValidationError")
"""FastAPI's own models, which no answer follows."""

GZIP_FROM_BYTES = 1000
GZIP_LEVEL = 1  # higher levels cost half the throughput for a few percent of size (spec 8)


def create_app(settings: Settings | None = None) -> FastAPI:
    """The application; ``settings`` default to those of the environment.

    Nothing is opened before it starts; starting without a database named is a ``SettingsError``.
    """
    chosen = settings or get_settings()
    figures = metrics.Metrics(lambda: _gauges(app))
    request_classes = make_request_classes(chosen.db_pool_size)
    app = FastAPI(
        title="Versant",
        summary="Slopes of roads from vehicle logs",
        description=DESCRIPTION,
        version=code_version(),
        openapi_tags=[{"name": name, "description": meaning} for name, meaning in TAGS.items()],
        license_info={"name": "Apache 2.0", "identifier": "Apache-2.0"},
        openapi_url=None,  # app.map.items.landing answers, in two versions and as a page
        docs_url=None,  # its pages load scripts from elsewhere
        redoc_url=None,
        lifespan=_lifespan,
        middleware=_middleware(chosen, figures, request_classes),
    )
    app.state.settings, app.state.metrics, app.state.request_classes = chosen, figures, request_classes
    install_error_handlers(app)
    for router in ROUTERS:
        app.include_router(router)
    describe(app, tell_rules, partial(tell_limits, settings=chosen))
    return app


def _middleware(
    settings: Settings, figures: metrics.Metrics, request_classes: Mapping[str, RequestClass]
) -> list[Middleware]:
    """The outermost first."""
    return [
        Middleware(Forwarded, proxies=settings.proxies),
        Middleware(middleware.CollectAfterRequests),
        Middleware(Turnstile),
        Middleware(middleware.HeadMiddleware),
        Middleware(RequestLog, observe=figures.observe),
        Middleware(middleware.KnownHosts, settings=settings),
        *([Middleware(middleware.PublishedCors, origins=settings.origins)] if settings.origins else []),
        Middleware(Gate, settings=settings, routes=[*known_routes()]),
        Middleware(TileFront, max_zoom=settings.tile_max_zoom),
        Middleware(EndWithClient),
        Middleware(middleware.EarlyAnswers),
        Middleware(Bodies, body_timeout_s=settings.body_timeout_s, upload_stall_s=settings.upload_stall_s),
        Middleware(Admission, request_classes=request_classes),
        Middleware(middleware.SameOriginWrites, public_url=settings.public_url),
        # It leaves event streams and pictures alone, and compresses large answers in a thread.
        Middleware(middleware.Compressed, minimum_size=GZIP_FROM_BYTES, compresslevel=GZIP_LEVEL),
    ]


@asynccontextmanager
async def _lifespan(app: FastAPI) -> AsyncIterator[None]:
    settings: Settings = app.state.settings
    if settings.database_url is None:
        raise SettingsError(say("cli.no_database_url"))
    patience = Patience(settings.statement_timeout_s, settings.lock_timeout_s, settings.pool_timeout_s)
    pooled = settings.database_pooled
    connect = partial(make_engine, settings.database_url, patience=patience, pooled=pooled)
    engine = guard(connect(pool_size=settings.db_pool_size, max_overflow=MORE_CONNECTIONS))
    probing = connect(pool_size=1, max_overflow=1)
    standby = app.state.metrics.standby = standby_of(settings, patience, session_factory(probing))
    app.state.service = Service(
        settings,
        engine,
        session_factory(engine),
        BlobStore(settings.blob_store_url),
        app.state.request_classes,
        session_factory(probing),
        CapacityLimiter(2),
        edition_note,
        standby=standby,
    )
    app.state.callers = Callers(session_factory(engine))
    app.state.quota_looks = live.QuotaLooks()
    app.state.logins = Logins(Provider(settings) if settings.oidc_issuer else None)
    app.state.archives = RequestClass(archive.AT_ONCE, for_others=archive.AT_ONCE)
    app.state.drawing = Drawing(settings.pictures_waiting)
    streams = Shares(settings.events_max, settings.events_per_client)
    app.state.feed = feed.Feed(
        partial(_read_drives, session_factory(engine)),
        settings.events_poll_s,
        streams,
        announced=settings.listen_url is not None,
    )
    announcements = Announcements(settings.listen_url, [app.state.callers, app.state.feed])
    app.state.tiles = MapTiles(settings, app.state.request_classes, standby)
    app.state.live = Live(app.state.tiles, streams)
    followed = [announcements, app.state.feed, app.state.tiles, app.state.live]
    followed += [] if standby is None else [standby]
    if settings.shown_map == "releases":
        app.state.edition_tiles = MapTiles(settings, app.state.request_classes, standby, EDITION)
        app.state.edition_live = Live(app.state.edition_tiles, streams)
        followed += [app.state.edition_tiles, app.state.edition_live]
    beside = [asyncio.create_task(one.run()) for one in followed]
    try:
        yield
    finally:
        for task in beside:
            task.cancel()
            with suppress(asyncio.CancelledError):
                await task
        for one in followed:
            if isinstance(one, MapTiles):
                await one.close()
        app.state.drawing.close()
        if standby is not None:
            standby.close()
        engine.dispose()
        probing.dispose()


def _read_drives(sessions: Sessions, ids: Collection[uuid.UUID]) -> dict[uuid.UUID, Drive]:
    with (
        as_caller(SERVICE),
        sessions() as session,
    ):  # for all who follow; each was let to it by its own rights
        return get_drives(session, ids)


def known_routes() -> Iterator[tuple[str, str]]:
    """Method and path of every route, in the order in which they are asked."""
    for router in ROUTERS:
        for route in router.routes:
            if isinstance(route, APIRoute):
                yield from ((method, route.path) for method in sorted(route.methods or ()))


def _gauges(app: FastAPI) -> metrics.Gauges | None:
    service: Service = app.state.service
    try:
        with service.reading() as session:
            return metrics.read_gauges(session)
    except SQLAlchemyError:
        return None


def describe(app: FastAPI, *complete: Callable[[dict[str, Any]], None]) -> None:
    """Make ``app.openapi`` answer with problem documents in place of FastAPI's own error models.

    Each of ``complete`` adds what a subject knows.
    """
    derive = app.openapi

    def corrected() -> dict[str, Any]:
        if app.openapi_schema is None:
            app.openapi_schema = _corrected(derive())
            for add in complete:
                add(app.openapi_schema)
        return app.openapi_schema

    app.openapi = corrected  # type: ignore[method-assign]


def _corrected(document: dict[str, Any]) -> dict[str, Any]:
    schemas = document.setdefault("components", {}).setdefault("schemas", {})
    for name in FASTAPI_ERRORS:
        schemas.pop(name, None)
    problem = Problem.model_json_schema(ref_template="#/components/schemas/{model}")
    schemas.update(problem.pop("$defs", {}))
    schemas["Problem"] = problem
    for path in document["paths"].values():
        for operation in path.values():
            _drop_fastapi_errors(operation)
    return document


def _drop_fastapi_errors(operation: dict[str, Any]) -> None:
    # FastAPI announces its own 422 for every route with a parameter; here a bad path is a 404.
    answers = operation["responses"]
    schema = answers.get("422", {}).get("content", {}).get("application/json", {}).get("schema", {})
    if schema.get("$ref", "").endswith(FASTAPI_ERRORS):
        del answers["422"]
