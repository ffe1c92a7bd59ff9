"""What can be chosen for a drive: the schemas say what uploads take, no more and no less."""

from __future__ import annotations

from typing import Any

import pytest

from fusion.catalogue import METHODS, POSITIONINGS
from fusion.registry import LOG_COLUMNS
from processing_support import HEADER


@pytest.fixture(scope="module")
def catalogue(reading: Any) -> dict[str, Any]:
    answer = reading.client.get("/v1/methods")
    assert answer.status_code == 200
    assert "max-age" in answer.headers["cache-control"]
    document: dict[str, Any] = answer.json()
    return document


def test_all_that_there_is(catalogue: dict[str, Any]) -> None:
    assert [one["name"] for one in catalogue["methods"]] == list(METHODS)
    assert [one["name"] for one in catalogue["positionings"]] == list(POSITIONINGS)
    assert tuple(catalogue["columns"]) == LOG_COLUMNS
    assert catalogue["default"] == "profile"
    for one in catalogue["methods"] + catalogue["positionings"]:
        assert one["title"]
        assert one["description"].startswith(one["title"])
        for name, schema in one["options"]["properties"].items():
            assert "default" in schema, name
            assert schema["description"], name


def test_the_default_is_the_service_s(web: Any) -> None:
    assert web.client.get("/v1/methods").json()["default"] == "raw"


def values_of(schema: dict[str, Any]) -> tuple[list[Any], list[Any]]:
    """Values at the edges that fit the schema, and some that do not."""
    if "anyOf" in schema:
        return values_of(schema["anyOf"][0])
    if "enum" in schema or "const" in schema:
        return list(schema.get("enum") or [schema["const"]]), ["no such"]
    if schema.get("type") == "boolean":
        return [True, False], ["perhaps"]
    good = [schema[edge] for edge in ("minimum", "maximum") if edge in schema]
    bad = [schema[edge] for edge in ("exclusiveMinimum", "exclusiveMaximum") if edge in schema]
    bad += [schema["minimum"] - 1] if "minimum" in schema else []
    bad += [schema["maximum"] + 1] if "maximum" in schema else []
    return good, bad


@pytest.mark.parametrize("kind", ["methods", "positionings"])
def test_what_the_schema_allows_is_taken_and_nothing_else(
    web: Any, catalogue: dict[str, Any], kind: str
) -> None:
    said = "option" if kind == "methods" else "gnss_option"
    address = web.client.post("/v1/drives?method=raw", content=HEADER + b"1,49,8\n").headers["location"]
    for one in catalogue[kind]:
        chosen = {"method": one["name"]} if kind == "methods" else {"method": "raw", "gnss": one["name"]}
        for name, schema in one["options"]["properties"].items():
            good, bad = values_of(schema)
            for value, status in [(v, 202) for v in good[:1]] + [(v, 422) for v in bad[:1]]:
                asked = {**chosen, said: f"{name}:{str(value).lower() if value in (True, False) else value}"}
                answer = web.client.post(f"{address}/reprocess", params=asked)
                assert answer.status_code == status, (one["name"], name, value, answer.text)
