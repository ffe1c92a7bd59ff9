"""The API's document in OpenAPI 3.0, which many clients still want: made from the one in 3.1.

A schema of 3.1 is JSON Schema; one of 3.0 is an older dialect of its own. What the older one cannot say (names of
properties by pattern, conditions) is left out: it then allows more, never less. Where a part that allows more would
make the whole allow less, in ``oneOf`` and ``not``, the whole is loosened too. Sources: OpenAPI 3.0.3 and 3.1.0.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping
from itertools import count
from typing import Any

Json = dict[str, Any]

VERSION = "3.0.3"
_LICENSES = {"Apache-2.0": "https://www.apache.org/licenses/LICENSE-2.0"}
"""3.0 wants an address where 3.1 takes an identifier."""

_ONLY_31 = frozenset({
    "$schema", "$id", "$anchor", "$comment", "$defs", "$dynamicRef", "$dynamicAnchor", "$vocabulary", "if", "then",
    "else", "contains", "minContains", "maxContains", "patternProperties", "propertyNames", "dependentSchemas",
    "dependentRequired", "unevaluatedItems", "unevaluatedProperties", "contentEncoding", "contentSchema",
})  # fmt: skip
_LISTS = ("allOf", "anyOf", "oneOf")
_EXACT = frozenset({
    "type", "enum", "const", "minimum", "maximum", "exclusiveMinimum", "exclusiveMaximum", "multipleOf", "minLength",
    "maxLength", "pattern", "format", "minItems", "maxItems", "uniqueItems", "minProperties", "maxProperties",
    "required", "properties", "additionalProperties", "items", "prefixItems", "not", *_LISTS, "title", "description",
    "default", "example", "examples", "deprecated", "contentMediaType",
})  # fmt: skip
"""What can be said in both versions, as long as it can be said of all parts."""

_TOGETHER = (frozenset({"type", "nullable"}), frozenset({"properties", "additionalProperties"}))
"""What means something else beside each other than in schemas of their own."""

_NULL = {"type": "null"}
_NULL_30 = {"enum": [None], "nullable": True}
_METHODS = frozenset({"get", "put", "post", "delete", "options", "head", "patch", "trace"})


def openapi_30(document: Mapping[str, Any]) -> Json:
    """The document in 3.0.3; ``document``, in 3.1, stays as it is."""
    older: Json = json.loads(json.dumps(document))
    older["openapi"] = VERSION
    for name in ("webhooks", "jsonSchemaDialect"):
        older.pop(name, None)
    older["info"].pop("summary", None)
    identifier = older["info"].get("license", {}).pop("identifier", None)
    if identifier in _LICENSES:
        older["info"]["license"]["url"] = _LICENSES[identifier]
    components = older.setdefault("components", {})
    components.pop("pathItems", None)
    components["schemas"] = {
        name: schema_30(schema) for name, schema in components.get("schemas", {}).items()
    }
    older["paths"] = {path: _place(item) for path, item in older.get("paths", {}).items()}
    _share_parameters(older)
    return older


def schema_30(schema: Any) -> Json:
    """A schema of 3.1 as one of 3.0."""
    if isinstance(schema, bool):
        return {} if schema else {"not": {}}
    older: Json = {name: value for name, value in schema.items() if name not in _ONLY_31}
    _more_properties(older, schema.get("patternProperties", {}))
    _values(older)
    _limits(older)
    _lists_of_items(older)
    _parts(older)
    _choices(older)
    _types(older)
    if "$ref" in older and len(older) > 1:
        # In 3.0 nothing that stands beside a reference counts.
        _and(older, {"$ref": older.pop("$ref")})
    return older


def _is_exact(schema: Any) -> bool:
    """Whether ``schema_30`` allows no more than this schema of 3.1 does; False where that is not known."""
    if isinstance(schema, bool):
        return True
    if not schema.keys() <= _EXACT:
        return False
    of_places, rest = schema.get("prefixItems", []), schema.get("items", True)
    if of_places and not _all_same([*of_places, *([] if rest is False else [rest])]):
        return False
    parts = [
        *schema.get("properties", {}).values(),
        *(schema[name] for name in ("items", "additionalProperties", "not") if name in schema),
        *(part for name in ("prefixItems", *_LISTS) for part in schema.get(name, [])),
    ]
    return all(_is_exact(part) for part in parts)


def _and(schema: Json, other: Json) -> None:
    """Let ``schema`` ask for what ``other`` asks for, besides."""
    if "$ref" not in other and _can_stand_beside(other, schema):
        schema.update(other)
    else:
        schema["allOf"] = [*schema.get("allOf", []), other]


def _can_stand_beside(one: Json, other: Json) -> bool:
    """Whether both say together what they say apart."""
    return not one.keys() & other.keys() and not any(
        group & one.keys() and group & other.keys() for group in _TOGETHER
    )


def _place(value: Any) -> Any:
    """A part of the document that is no schema, with the schemas in it made anew; examples stay as they are."""
    if isinstance(value, list):
        return [_place(one) for one in value]
    if not isinstance(value, dict):
        return value
    return {
        name: part
        if name in {"example", "examples"}
        else schema_30(part)
        if name == "schema"
        else _place(part)
        for name, part in value.items()
    }


def _more_properties(schema: Json, patterns: Mapping[str, Any]) -> None:
    """Properties that patterns name would otherwise count as additional ones, and those may be forbidden."""
    rest = schema.get("additionalProperties", True)
    if patterns and rest is not True:
        schema["additionalProperties"] = {"anyOf": [*patterns.values(), *([] if rest is False else [rest])]}


def _values(schema: Json) -> None:
    if "const" in schema:
        _and(schema, {"enum": [schema.pop("const")]})
    examples = schema.pop("examples", None)
    if examples:
        schema.setdefault("example", examples[0])
    if schema.pop("contentMediaType", None):
        schema.setdefault("format", "binary")


def _limits(schema: Json) -> None:
    for limit in ("minimum", "maximum"):
        exclusive = "exclusive" + limit.capitalize()
        bound = schema.get(exclusive)
        if bound is None or isinstance(bound, bool):
            continue
        inner = schema.get(limit)
        tighter = max if limit == "minimum" else min
        if inner is None or tighter(inner, bound) == bound:
            schema[limit], schema[exclusive] = bound, True
        else:
            del schema[exclusive]


def _lists_of_items(schema: Json) -> None:
    """A list whose items differ by their place becomes one of so many items of any of these kinds."""
    first = schema.pop("prefixItems", None)
    if first is None:
        return
    rest = schema.pop("items", True)
    kinds = [*first, *([rest] if isinstance(rest, dict) else [])]
    if rest is False:
        schema["maxItems"] = min(len(first), schema.get("maxItems", len(first)))
    schema["items"] = {} if rest is True else kinds[0] if _all_same(kinds) else {"anyOf": kinds}


def _parts(schema: Json) -> None:
    if "properties" in schema:
        schema["properties"] = {name: schema_30(part) for name, part in schema["properties"].items()}
    if not _is_exact(schema.get("not", True)):
        # What is forbidden would grow with what is allowed in there.
        del schema["not"]
    for name in ("items", "not"):
        if name in schema:
            schema[name] = schema_30(schema[name])
    if isinstance(schema.get("additionalProperties"), dict):
        schema["additionalProperties"] = schema_30(schema["additionalProperties"])
    type_ = schema.get("type")
    if type_ == "array" or (isinstance(type_, list) and "array" in type_):
        schema.setdefault("items", {})


def _choices(schema: Json) -> None:
    lists = {name: schema.pop(name) for name in _LISTS if name in schema}
    for name, parts in lists.items():
        kinds = parts if name == "allOf" else [kind for kind in parts if kind != _NULL]
        nulls = len(parts) - len(kinds)
        older = [schema_30(kind) for kind in kinds]
        only = older[0] if len(older) == 1 else None
        if only is not None and "$ref" in only:
            # As generators of clients read it; to the letter nullable says nothing where there is no type beside it.
            _and(schema, only)
            schema.update({"nullable": True} if nulls else {})
        elif (
            only is not None
            and (not nulls or _takes_null(name, nulls, only))
            and _can_stand_beside(only, schema)
        ):
            schema.update(only)
            schema.update({"nullable": True} if nulls else {})
        else:
            # Alternatives of which one allows more now may no longer exclude each other.
            loosened = name == "oneOf" and not all(_is_exact(kind) for kind in kinds)
            _and(schema, {"anyOf" if loosened else name: [*older, *(dict(_NULL_30) for _ in range(nulls))]})


def _takes_null(name: str, nulls: int, kind: Json) -> bool:
    """Whether null as the other alternative is said by nullable; one of two that both allow it would be neither."""
    return "type" in kind and (name == "anyOf" or (nulls == 1 and "nullable" not in kind))


def _types(schema: Json) -> None:
    types = schema.pop("type", None)
    kinds = types if isinstance(types, list) else [] if types is None else [types]
    with_null = {"nullable": True} if "null" in kinds else {}
    kinds = [kind for kind in kinds if kind != "null"]
    if with_null and not kinds:
        _and(schema, dict(_NULL_30))
    elif len(kinds) == 1:
        schema.update({"type": kinds[0], **with_null})
    elif kinds:
        # Nullable counts only beside a type.
        items = schema.pop("items", {})
        of_types = [
            {"type": kind, **with_null, **({"items": items} if kind == "array" else {})} for kind in kinds
        ]
        _and(schema, {"anyOf": of_types})


def _share_parameters(document: Json) -> None:
    """Parameters of several operations that are the same become components.

    That is shorter, and GDAL looks for the size of a page only in a parameter that is a reference.
    """
    lists = [
        operation["parameters"]
        for item in document["paths"].values()
        for method, operation in item.items()
        if method in _METHODS and "parameters" in operation
    ]
    times = Counter(_text(parameter) for parameters in lists for parameter in parameters)
    shared: dict[str, Json] = document["components"].setdefault("parameters", {})
    names: dict[str, str] = {}
    for parameters in lists:
        for index, parameter in enumerate(parameters):
            text = _text(parameter)
            if times[text] > 1 and "$ref" not in parameter:
                if text not in names:
                    name = parameter["name"]
                    free = (name if number == 1 else f"{name}-{number}" for number in count(1))
                    names[text] = next(one for one in free if one not in shared)
                    shared[names[text]] = parameter
                parameters[index] = {"$ref": f"#/components/parameters/{names[text]}"}


def _all_same(values: list[Any]) -> bool:
    """To Python true is 1."""
    return len({_text(value) for value in values}) == 1


def _text(value: Any) -> str:
    return json.dumps(value, sort_keys=True)
