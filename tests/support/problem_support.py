"""What tests of the API's answers share: every operation that there is, and what a problem document must say."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from app.core.errors import all_kinds
from app.core.settings import Settings
from app.main import create_app
from fusion.messages import catalogue

DESCRIPTION = create_app(Settings()).openapi()


def operations() -> Iterator[tuple[str, str, dict[str, Any]]]:
    for path, item in DESCRIPTION["paths"].items():
        for method, operation in item.items():
            yield method.upper(), path, operation


OPERATIONS = [pytest.param(*operation, id=f"{operation[0]} {operation[1]}") for operation in operations()]


def check(answer: Any, *statuses: int) -> dict[str, Any]:
    assert answer.status_code in statuses, f"{answer.request.url}: {answer.status_code} {answer.text}"
    assert answer.headers["content-type"] == "application/problem+json"
    problem: dict[str, Any] = answer.json()
    assert set(problem) - {"said"} == {"type", "title", "status", "detail", "instance", "errors"}
    assert "said" not in problem or problem["said"]["key"] in catalogue("de")
    assert problem["status"] == answer.status_code
    assert problem["instance"] == answer.request.url.path
    assert problem["type"].removeprefix("/problems/") in all_kinds()
    assert problem["detail"].endswith(".")
    return problem
