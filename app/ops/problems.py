"""What the ``type`` of a problem document leads to."""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter
from pydantic import BaseModel, ConfigDict

from app.core.errors import PROBLEM_PATH, Kind, NotFoundError, all_kinds
from app.core.http import problems
from app.core.messages import say

router = APIRouter(prefix=PROBLEM_PATH.rstrip("/"), tags=["operation"])


EXAMPLE: dict[str, Any] = {
    "type": "/problems/no-match",
    "status": 422,
    "title": "No road near",
    "meaning": "The log ...",
}


class ProblemKind(BaseModel):
    """A kind of problem."""

    model_config = ConfigDict(json_schema_extra={"examples": [EXAMPLE]})

    type: str
    status: int
    title: str
    meaning: str

    @classmethod
    def of(cls, kind: Kind) -> ProblemKind:
        """Build from a row of the table."""
        return cls(type=PROBLEM_PATH + kind.slug, status=kind.status, title=kind.title, meaning=kind.meaning)


@router.get("", summary="All kinds of problems")
def list_kinds() -> list[ProblemKind]:
    """Every `type` that a problem document of this service can have."""
    return [ProblemKind.of(kind) for kind in all_kinds().values()]


@router.get("/{slug}", summary="One kind of problem", responses=problems(404))
def get_kind(slug: str) -> ProblemKind:
    """What the `type` of a problem document means."""
    kind = all_kinds().get(slug)
    if kind is None:
        raise NotFoundError(say("service.no_problem", name=slug))
    return ProblemKind.of(kind)
