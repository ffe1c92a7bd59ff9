"""Liveness and readiness: whether the process runs, and whether it can answer."""

from __future__ import annotations

import logging

from anyio import to_thread
from fastapi import APIRouter
from pydantic import BaseModel, ConfigDict, Field
from sqlalchemy.exc import SQLAlchemyError

from app.core import migrate
from app.core.errors import FieldError, NotReadyError
from app.core.http import Service, ServiceDep, problems
from app.ops.store import schema_revision

log = logging.getLogger(__name__)

router = APIRouter(tags=["operation"])


class Health(BaseModel):
    """The service's own state."""

    model_config = ConfigDict(
        json_schema_extra={"examples": [{"status": "ready", "checks": {"database": "ok", "blobs": "ok"}}]}
    )

    status: str
    checks: dict[str, str] = Field(default={}, description="Each thing needed: ok, or what is wrong with it.")


@router.get("/healthz", summary="Liveness")
async def healthz() -> Health:
    """Answers as long as the process does; asks nothing of the database, and waits for no thread."""
    return Health(status="ok")


@router.get("/readyz", summary="Readiness", responses=problems(503))
async def readyz(service: ServiceDep) -> Health:
    """Whether requests can be answered: database reachable and migrated, blob store writable."""
    return await to_thread.run_sync(_ready, service, limiter=service.probe_threads)


def _ready(service: Service) -> Health:
    checks = {"database": _database(service), "blobs": _blobs(service)}
    bad = [FieldError(field=name, message=state) for name, state in checks.items() if state != "ok"]
    if bad:
        raise NotReadyError(" ".join(error.message for error in bad), errors=bad)
    return Health(status="ready", checks=checks)


def _database(service: Service) -> str:
    wanted = migrate.latest_revision()
    try:
        with service.probes() as session:
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
