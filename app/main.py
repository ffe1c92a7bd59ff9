"""The application: every subject's routes, and what wraps them. A new group is one module and one line here."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from fastapi import APIRouter, FastAPI
from sqlalchemy.exc import SQLAlchemyError
from starlette.middleware import Middleware
from starlette.middleware.gzip import GZipMiddleware

from app.core.blobs import BlobStore
from app.core.db import make_engine, session_factory
from app.core.http import Service
from app.core.middleware import EarlyAnswers, HeadMiddleware, PublishedCors, SameOriginWrites, SmallBodies
from app.core.openapi import TAGS, describe
from app.core.problems import install_error_handlers
from app.core.settings import Settings, SettingsError, get_settings
from app.core.version import code_version
from app.drives import batches, events, upload
from app.drives import results as drive_parts
from app.drives import routes as drives
from app.map import features, segments, tiles
from app.map.features import BIND_NOTE
from app.ops import health, stats
from app.ops import problems as problem_kinds
from app.ops.metrics import Gauges, Metrics, MetricsMiddleware, read_gauges
from app.ops.metrics import router as metrics_router

ROUTERS: tuple[APIRouter, ...] = (
    upload.router,
    batches.router,  # before drives: its path would else be taken for a drive's
    drives.router,
    events.router,
    drive_parts.router,
    segments.router,
    features.router,
    tiles.router,
    stats.router,
    health.router,
    metrics_router,
    problem_kinds.router,
)


DESCRIPTION = f"""Versant measures the slope of roads. Upload what a vehicle recorded; read the slope of every
road segment that was driven, with its uncertainty, as GeoJSON and as tiles.

Slopes are in percent, positive uphill from `from_node` to `to_node`, the direction in which the OpenStreetMap
way is drawn; sigma is one standard deviation; unknown is null, never 0. Times are UTC. Errors are problem
documents (RFC 9457). {BIND_NOTE}"""

GZIP_FROM_BYTES = 1000
GZIP_LEVEL = 1  # higher levels cost half the throughput for a few percent of size (spec 8)


def create_app(settings: Settings | None = None) -> FastAPI:
    """The application; ``settings`` default to those of the environment.

    Nothing is opened before it starts; starting without a database named is a ``SettingsError``.
    """
    chosen = settings or get_settings()
    metrics = Metrics(lambda: _gauges(app))
    app = FastAPI(
        title="Versant",
        summary="Slopes of roads from vehicle logs",
        description=DESCRIPTION,
        version=code_version(),
        openapi_tags=TAGS,
        license_info={"name": "Apache 2.0", "identifier": "Apache-2.0"},
        docs_url=None,  # its pages load scripts from elsewhere
        redoc_url=None,
        lifespan=_lifespan,
        middleware=_middleware(chosen, metrics),
    )
    app.state.settings, app.state.metrics = chosen, metrics
    install_error_handlers(app)
    for router in ROUTERS:
        app.include_router(router)
    describe(app)
    return app


def _middleware(settings: Settings, metrics: Metrics) -> list[Middleware]:
    """The outermost first."""
    return [
        Middleware(HeadMiddleware),
        Middleware(MetricsMiddleware, metrics=metrics),
        Middleware(EarlyAnswers),
        Middleware(PublishedCors),
        Middleware(SmallBodies),
        Middleware(SameOriginWrites, public_url=settings.public_url),
        # It leaves event streams and pictures alone, and compresses large answers in a thread.
        Middleware(GZipMiddleware, minimum_size=GZIP_FROM_BYTES, compresslevel=GZIP_LEVEL),
    ]


@asynccontextmanager
async def _lifespan(app: FastAPI) -> AsyncIterator[None]:
    settings: Settings = app.state.settings
    if settings.database_url is None:
        raise SettingsError(
            "VERSANT_DATABASE_URL is not set. Name a PostgreSQL database with PostGIS, or start everything "
            "at once with `versant up`, which brings its own."
        )
    engine = make_engine(settings.database_url, pool_size=settings.db_pool_size)
    blobs = BlobStore(settings.blob_store_url)
    app.state.service = Service(settings, engine, session_factory(engine), blobs)
    try:
        yield
    finally:
        engine.dispose()


def _gauges(app: FastAPI) -> Gauges | None:
    service: Service = app.state.service
    try:
        with service.reading() as session:
            return read_gauges(session)
    except SQLAlchemyError:
        return None
