"""Figures for operators."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Query

from app.core.http import ServiceDep, problems
from app.ops.documents import Stats
from app.ops.store import admin_stats

router = APIRouter(prefix="/v1/admin", tags=["operation"])


@router.get("/stats", summary="Figures for operators", responses=problems(422, 503))
def stats(
    service: ServiceDep,
    days: Annotated[
        int, Query(ge=1, le=366, description="How many days back drives are counted by day.")
    ] = 30,
) -> Stats:
    """Drives by status and day, the queue, failures by reason, kilometres covered by road class."""
    with service.reading() as session:
        return Stats.of(admin_stats(session, days=days))
