"""Liveness, readiness, metrics."""

from __future__ import annotations

import logging

from fastapi import APIRouter, Request, Response
from sqlalchemy.exc import SQLAlchemyError

from app.core import migrate
from app.core.errors import FieldError, NotReadyError
from app.core.http import Service, ServiceDep, problems
from app.ops.documents import Health
from app.ops.metrics import CONTENT_TYPE, Metrics
from app.ops.store import schema_revision

log = logging.getLogger(__name__)

router = APIRouter(tags=["operation"])


@router.get("/healthz", summary="Liveness")
def healthz() -> Health:
    """Answers as long as the process does; asks nothing of the database."""
    return Health(status="ok")


@router.get("/readyz", summary="Readiness", responses=problems(503))
def readyz(service: ServiceDep) -> Health:
    """Whether requests can be answered: database reachable and migrated, blob store writable."""
    checks = {"database": _database(service), "blobs": _blobs(service)}
    bad = [FieldError(field=name, message=state) for name, state in checks.items() if state != "ok"]
    if bad:
        raise NotReadyError(" ".join(error.message for error in bad), errors=bad)
    return Health(status="ready", checks=checks)


@router.get(
    "/metrics",
    summary="Prometheus metrics",
    response_class=Response,
    responses={
        200: {
            "description": "Text exposition format.",
            "content": {
                "text/plain": {
                    "schema": {"type": "string"},
                    "example": 'versant_drives{status="done"} 12.0\n',
                }
            },
        }
    },
)
def metrics(request: Request) -> Response:
    """Requests by route and status with their durations, drives by status, the queue."""
    figures: Metrics = request.app.state.metrics
    return Response(figures.exposition(), headers={"Content-Type": CONTENT_TYPE})


def _database(service: Service) -> str:
    wanted = migrate.latest_revision()
    try:
        with service.reading() as session:
            revision = schema_revision(session)
    except SQLAlchemyError:
        log.exception("readiness: the database cannot be used")
        return "The database does not answer."
    if revision != wanted:
        return f"The database is at migration {revision}, this program needs {wanted}: run `versant migrate`."
    return "ok"


def _blobs(service: Service) -> str:
    try:
        with service.blobs.writer() as writer:  # left unfinished, it leaves nothing behind
            writer.write(b"ready")
    except Exception:  # any storage fsspec knows, each with errors of its own
        log.exception("readiness: the blob store cannot be written to")
        return "The store of uploaded logs cannot be written to."
    return "ok"
