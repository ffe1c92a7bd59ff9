"""The API's description says what there is."""

from __future__ import annotations

import re
from typing import Any

import pytest

from problem_support import DESCRIPTION, OPERATIONS


@pytest.mark.parametrize(("method", "path", "operation"), OPERATIONS)
def test_every_route_is_described_with_an_example(method: str, path: str, operation: Any) -> None:
    schemas = DESCRIPTION["components"]["schemas"]
    assert operation["summary"]
    assert operation["description"]
    assert operation["tags"]
    good = [answer for status, answer in operation["responses"].items() if status in {"200", "202"}]
    if method == "DELETE":
        return
    for answer in good:
        for media_type, content in answer["content"].items():
            if media_type.startswith(("image/", "application/vnd.mapbox")):
                continue
            assert content.get("example") or _examples(content["schema"], schemas), (method, path, media_type)
    for status, answer in operation["responses"].items():
        if int(status) >= 400:
            (content,) = answer["content"].items()
            assert content[0] == "application/problem+json"
            assert content[1]["example"]["status"] == int(status)


def _examples(schema: dict[str, Any], schemas: dict[str, Any]) -> Any:
    schema = schema.get("items", schema)
    return schemas[schema["$ref"].rsplit("/", 1)[-1]].get("examples") if "$ref" in schema else None


def test_every_reference_of_the_description_resolves(reading: Any) -> None:
    document = reading.client.get("/openapi.json").json()
    schemas = document["components"]["schemas"]
    references = set(re.findall(r"#/components/schemas/(\w+)", reading.client.get("/openapi.json").text))
    assert references <= set(schemas)
    assert "HTTPValidationError" not in schemas
    assert "loopback" in document["info"]["description"]
