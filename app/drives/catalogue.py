"""The methods with their options as JSON Schema, and the ways to positions with theirs: what a form is made of.

The methods are loaded at the first request (with their compilers they take much of a process's memory), and answered
from memory from then on.
"""

from __future__ import annotations

from functools import lru_cache
from threading import Lock
from typing import Any

from fastapi import APIRouter, Response
from pydantic import BaseModel, Field

from app.core.http import ServiceDep
from app.drives.method_choice import default_method
from app.drives.receiving.zips import MAX_FILES
from fusion.registry import DEFAULT_POSITIONING, LOG_COLUMNS

KEPT = "max-age=300"
_OWN_WAY = frozenset({"gnss", "gnss_options", "columns"})
"""Options that every method has: they are described, and chosen, by themselves."""
_SCHEMA_EXAMPLE: dict[str, Any] = {
    "type": "object",
    "additionalProperties": False,
    "properties": {
        "particles": {
            "type": "integer",
            "minimum": 100,
            "maximum": 1_000_000,
            "default": 3000,
            "title": "Particles",
            "description": "Number of particles.",
        }
    },
}

_loading = Lock()
router = APIRouter(prefix="/v1/methods", tags=["drives"])


class Choice(BaseModel):
    """Something that is chosen by its name."""

    name: str = Field(description="What a request writes.")
    title: str = Field(description="The description's beginning, for a list.")
    description: str = Field(description="One sentence for a person who chooses.")
    source: str = Field(description="Where it comes from.")
    options: dict[str, Any] = Field(
        description="JSON Schema of its options: an object; each property with its default, range and description."
    )


class MethodChoice(Choice):
    """An estimator."""

    needs: list[str] = Field(description="What the log and its surroundings must have, in words.")


_EXAMPLE: dict[str, Any] = {
    "default": "profile",
    "methods": [
        {
            "name": "particle",
            "title": "A particle filter on the road network",
            "description": "A particle filter on the road network.",
            "source": "ours",
            "options": _SCHEMA_EXAMPLE,
            "needs": ["positions"],
        }
    ],
    "default_positioning": "auto",
    "positionings": [
        {
            "name": "receiver",
            "title": "Positions as logged",
            "description": "Positions as logged.",
            "source": "the receiver itself",
            "options": {"type": "object", "properties": {}},
        }
    ],
    "columns": ["time", "lat_deg", "lon_deg"],
    "max_files": 32,
}


class MethodList(BaseModel, json_schema_extra={"examples": [_EXAMPLE]}):
    """What can be chosen for a drive."""

    default: str = Field(description="The method of who names none.")
    methods: list[MethodChoice]
    default_positioning: str = Field(description="How positions are computed where nobody says.")
    positionings: list[Choice] = Field(
        description="Ways to compute positions: the query's `gnss` and `gnss_option`, or the options `gnss` and "
        "`gnss_options` of every method."
    )
    columns: list[str] = Field(description="Columns of a CSV log as Versant calls them: left of `columns=`.")
    max_files: int = Field(description="Files that one drive may come as.")


@router.get("", summary="What can be chosen for a drive")
def list_methods(service: ServiceDep, response: Response) -> MethodList:
    """The methods, the ways to positions and the columns that an upload or `reprocess` may name."""
    with _loading:  # who else asks while they are loaded waits for the same
        methods, positionings = _choices()
    response.headers["Cache-Control"] = KEPT
    return MethodList(
        default=default_method(service.settings),
        methods=list(methods),
        default_positioning=DEFAULT_POSITIONING,
        positionings=list(positionings),
        columns=list(LOG_COLUMNS),
        max_files=MAX_FILES,
    )


@lru_cache(maxsize=1)
def _choices() -> tuple[tuple[MethodChoice, ...], tuple[Choice, ...]]:
    from fusion.catalogue import METHODS, POSITIONINGS  # noqa: PLC0415 - see above

    methods = tuple(
        MethodChoice(**_facts(method, leave_out=_OWN_WAY), needs=list(method.needs))
        for _, method in METHODS.items()
    )
    return methods, tuple(Choice(**_facts(one)) for _, one in POSITIONINGS.items())


def _facts(thing: Any, leave_out: frozenset[str] = frozenset()) -> dict[str, Any]:
    schema = thing.options_model.model_json_schema()
    properties = {name: each for name, each in schema.get("properties", {}).items() if name not in leave_out}
    options = {"type": "object", "additionalProperties": False, "properties": properties}
    if "$defs" in schema:
        options["$defs"] = schema["$defs"]
    return {
        "name": thing.name,
        "title": _title(thing.description),
        "description": thing.description,
        "source": thing.source,
        "options": options,
    }


def _title(description: str) -> str:
    """The first clause of a sentence."""
    head = description.partition(". ")[0].partition(": ")[0].partition("; ")[0]
    return head.rstrip(".")
