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

log = logging.getLogger(__name__)

router = APIRouter(tags=["operation"])


class Health(BaseModel):
    """The service's own state."""

    model_config = ConfigDict(
        json_schema_extra={"examples": [{"status": "ready", "checks": {"database": "ok", "blobs": "ok"}}]}
    )

    status: str
    checks: dict[str, str] = Field(
        default={},
        description="Each thing needed: ok, or what is wrong with it. And a standby, without which it goes on.",
    )


@router.get("/healthz", summary="Liveness")
async def healthz() -> Health:
    """Answers as long as the process does; asks nothing of the database, and waits for no thread."""
    return Health(status="ok")


@router.get("/readyz", summary="Readiness", responses=problems(503))
async def readyz(service: ServiceDep) -> Health:
    """Whether requests can be answered: database reachable and migrated, blob store writable and not full."""
    return await to_thread.run_sync(_ready, service, limiter=service.probe_threads)


def _ready(service: Service) -> Health:
    checks = {"database": _database(service), "blobs": _blobs(service)}
    bad = [FieldError(field=name, message=state) for name, state in checks.items() if state != "ok"]
    if bad:
        raise NotReadyError(" ".join(error.message for error in bad), errors=bad)
    if service.standby is not None:
        checks["standby"] = service.standby.problem or "ok"
    return Health(status="ready", checks=checks)


def _database(service: Service) -> str:
    try:
        with service.probes() as session:
            standing = migrate.standing(session)
    except SQLAlchemyError:
        log.exception("readiness: the database cannot be used")
        return "The database does not answer."
    return "ok" if standing.usable else standing.sentence


def _blobs(service: Service) -> str:
    least = service.settings.min_free_bytes
    try:
        free = service.blobs.free_bytes()
        if free is not None and free < least:
            return (
                f"The store of uploaded logs has {free} bytes free, less than the {least} of VERSANT_MIN_FREE_BYTES. "
                "Make room there."
            )
        service.blobs.probe()
    except Exception:  # any storage fsspec knows, each with errors of its own
        log.exception("readiness: the blob store cannot be written to")
        return "The store of uploaded logs cannot be written to."
    return "ok"
