"""The OpenAPI document: what FastAPI derives, with problem documents in place of its own error models."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from fastapi import FastAPI

from app.core.problems import Problem

TAGS: list[dict[str, str]] = [
    {"name": "drives", "description": "Upload logs and look at what became of them."},
    {"name": "segments", "description": "One road segment, and the drives behind its slope."},
    {"name": "map", "description": "All road segments, as OGC API Features."},
    {
        "name": "changes",
        "description": "Following the map: what changed since a version, and being told of it.",
    },
    {"name": "tiles", "description": "Map tiles."},
    {
        "name": "heights",
        "description": "Heights of the road at places, as other services give them of the ground.",
    },
    {"name": "exports", "description": "The map, or a part of it, as files."},
    {
        "name": "operation",
        "description": "Health, metrics, figures and long work of operators, kinds of problems.",
    },
]
FASTAPI_ERRORS = ("HTTPValidationError", "ValidationError")
"""FastAPI's own models, which no answer follows."""


def describe(app: FastAPI, *completing: Callable[[dict[str, Any]], None]) -> None:
    """Make ``app.openapi`` answer with the corrected document; ``completing`` add what subjects know."""
    derive = app.openapi

    def corrected() -> dict[str, Any]:
        if app.openapi_schema is None:
            app.openapi_schema = _corrected(derive())
            for complete in completing:
                complete(app.openapi_schema)
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
