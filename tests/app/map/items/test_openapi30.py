"""The document in OpenAPI 3.0 says what the one in 3.1 says, as far as the older version can."""

from __future__ import annotations

import copy
from typing import Any

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from jsonschema import Draft202012Validator
from openapi_schema_validator import OAS30Validator

from app.map.items.openapi30 import openapi_30, schema_30

NUMBERS = st.integers(-3, 3)
VALUES = st.none() | st.booleans() | NUMBERS | st.sampled_from(["", "a", "bb"])
LIMITS = st.fixed_dictionaries(
    {"type": st.sampled_from(["integer", "number"])},
    optional={
        name: NUMBERS
        for name in ("minimum", "maximum", "exclusiveMinimum", "exclusiveMaximum", "multipleOf")
        if name != "multipleOf"
    },
)
NAMED = {"patternProperties": {"^x": True}}
TYPES = st.lists(
    st.sampled_from(["string", "integer", "boolean", "null"]), min_size=1, max_size=3, unique=True
)
PLAIN = st.one_of(
    LIMITS,
    st.builds(lambda types: {"type": types}, TYPES),
    st.builds(lambda value: {"const": value}, st.sampled_from([1, "a", True])),
    st.builds(
        lambda least: {"type": "string", "minLength": least, "examples": ["a"], "title": "T"},
        st.integers(0, 2),
    ),
    st.booleans(),
)


def deeper(parts: st.SearchStrategy[Any]) -> st.SearchStrategy[Any]:
    lists = st.lists(parts, min_size=1, max_size=3)
    return st.one_of(
        st.builds(lambda name, of: {name: of}, st.sampled_from(["anyOf", "oneOf", "allOf"]), lists),
        st.builds(lambda one: {"anyOf": [one, {"type": "null"}], "description": "Perhaps."}, parts),
        st.builds(lambda one: {"type": "array", "items": one, "maxItems": 3}, parts),
        st.builds(lambda of: {"type": "array", "prefixItems": of, "items": False}, lists),
        st.builds(
            lambda of, more: {"type": "object", "properties": of, "additionalProperties": more, **NAMED},
            st.dictionaries(st.sampled_from(["a", "x"]), parts),
            parts,
        ),
        st.builds(lambda one: {"not": one}, parts),
    )


SCHEMAS = st.recursive(PLAIN, deeper, max_leaves=5)
INSTANCES = st.recursive(
    VALUES,
    lambda parts: (
        st.lists(parts, max_size=3) | st.dictionaries(st.sampled_from(["a", "b", "x"]), parts, max_size=2)
    ),
    max_leaves=4,
)


ONE_BY_PLACE = {"type": "array", "prefixItems": [{"const": 1}, True], "items": False}
SOME_BY_NAME = {
    "type": "object",
    "patternProperties": {"^x": {"type": "string"}},
    "additionalProperties": False,
}


@example(  # the second alternative takes the first's item at any place, once it no longer says at which
    schema={"oneOf": [{"type": "array", "items": {"type": ["boolean"]}, "maxItems": 3}, ONE_BY_PLACE]},
    instances=[[False]],
)
@example(schema={"not": ONE_BY_PLACE}, instances=[[False]])
@example(schema={"oneOf": [{"not": ONE_BY_PLACE}, {"type": "string"}]}, instances=[[False], "a"])
@example(  # what is true and what is 1 are the same to Python
    schema={"type": "array", "prefixItems": [{"const": 1}, {"const": True}], "items": False},
    instances=[[1, True]],
)
@example(schema=SOME_BY_NAME, instances=[{"x": "a"}])
@example(schema={"oneOf": [{"allOf": [SOME_BY_NAME]}, {"type": "object"}]}, instances=[{"x": 1}])
@settings(max_examples=60, deadline=None)
@given(schema=SCHEMAS, instances=st.lists(INSTANCES, min_size=4, max_size=8))
def test_what_is_valid_in_3_1_is_valid_in_3_0(schema: Any, instances: list[Any]) -> None:
    """The older version allows more where it cannot say something, never less; and what is made of it is a schema."""
    before = copy.deepcopy(schema)
    made = schema_30(schema)
    assert schema == before
    OAS30Validator.check_schema(made)
    newer, older = Draft202012Validator(schema), OAS30Validator(made)
    for instance in instances:
        if newer.is_valid(instance):
            assert older.is_valid(instance), (schema, made, instance)


@pytest.mark.parametrize(
    ("schema", "instance"),
    [
        ({"oneOf": [{"type": ["integer", "null"]}, {"type": "null"}]}, None),
        ({"oneOf": [{"type": "null"}, {"type": "null"}]}, None),
        ({"oneOf": [{"type": "integer"}, {"type": "number"}]}, 1),
        ({"allOf": [{"type": "integer"}, {"type": "null"}]}, None),
        ({"type": "integer", "allOf": [{"type": ["null"]}]}, None),
        ({"type": "null", "const": "a"}, None),
        ({"const": "a", "enum": ["b"]}, "a"),
        ({"anyOf": [{"const": 1}, {"const": 2}], "type": ["string", "integer"]}, 3),
        ({"allOf": [{"anyOf": [{"const": 1}, {"const": 2}]}], "anyOf": [{"const": 1}, {"const": 3}]}, 3),
        ({"properties": {"a": True}, "allOf": [{"additionalProperties": False}]}, {"a": 1}),
        ({"not": {"type": "array", "prefixItems": [{"const": 1}] * 2, "items": False}}, [1]),
    ],
)
def test_what_3_0_can_say_stays_forbidden(schema: dict[str, Any], instance: Any) -> None:
    assert not Draft202012Validator(schema).is_valid(instance)
    assert not OAS30Validator(schema_30(schema)).is_valid(instance)


@pytest.mark.parametrize(
    ("schema", "expected"),
    [
        ({"oneOf": [{"type": "integer"}, {"const": "a"}]}, {"oneOf": [{"type": "integer"}, {"enum": ["a"]}]}),
        ({"type": ["string", "null"]}, {"type": "string", "nullable": True}),
        ({"anyOf": [{"type": "integer"}, {"type": "null"}]}, {"type": "integer", "nullable": True}),
        (
            {"anyOf": [{"$ref": "#/x"}, {"type": "null"}]},
            {"allOf": [{"$ref": "#/x"}], "nullable": True},
        ),
        ({"type": "number", "exclusiveMinimum": 0}, {"type": "number", "minimum": 0, "exclusiveMinimum": True}),
        ({"minimum": 3, "exclusiveMinimum": 1}, {"minimum": 3}),
        ({"const": "a"}, {"enum": ["a"]}),
        ({"type": "string", "examples": ["a", "b"]}, {"type": "string", "example": "a"}),
        ({"$ref": "#/x", "description": "d"}, {"allOf": [{"$ref": "#/x"}], "description": "d"}),
        ({"type": "string", "contentMediaType": "application/octet-stream"}, {"type": "string", "format": "binary"}),
        ({"type": "array", "prefixItems": [{"type": "number"}] * 2}, {"type": "array", "items": {}}),
        (
            {"type": "array", "prefixItems": [{"type": "number"}] * 2, "items": False},
            {"type": "array", "items": {"type": "number"}, "maxItems": 2},
        ),
    ],
)  # fmt: skip
def test_each_difference_between_the_versions(schema: dict[str, Any], expected: dict[str, Any]) -> None:
    assert schema_30(schema) == expected


def test_parameters_that_routes_share_are_components_and_nothing_is_lost(reading: Any) -> None:
    newer = reading.client.get("/openapi.json").json()
    older = reading.client.get("/openapi.json", params={"f": "openapi-3.0"}).json()
    assert older == openapi_30(newer)
    for path in ("/collections/segments/items", "/collections/ways/items"):
        of = [item["paths"][path]["get"]["parameters"] for item in (newer, older)]
        names = [one["name"] for one in of[0]]
        resolved = [
            older["components"]["parameters"][one["$ref"].rsplit("/", 1)[-1]] if "$ref" in one else one
            for one in of[1]
        ]
        assert [one["name"] for one in resolved] == names
        # GDAL looks for the size of a page in a reference that is called so.
        assert any("limit" in one.get("$ref", "") for one in of[1])
    assert set(older["paths"]) == set(newer["paths"])
