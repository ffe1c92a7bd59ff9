"""What methods and positionings have in common: how a person chooses them, and what their options are made of."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

from pydantic import BaseModel, ConfigDict, GetCoreSchemaHandler, GetJsonSchemaHandler
from pydantic_core import CoreSchema, core_schema

from fusion.errors import UnknownNameError
from fusion.registry import Registry


def _on_one_line(schema: dict[str, Any]) -> None:
    """Take the line breaks of docstrings out of descriptions."""
    for one in schema.get("properties", {}).values():
        if "description" in one:
            one["description"] = " ".join(one["description"].split())


class OptionsModel(BaseModel):
    """Base of all options: immutable, unknown names refused.

    The docstring under a field is its description for users and says the unit.
    """

    model_config = ConfigDict(
        frozen=True,
        extra="forbid",
        allow_inf_nan=False,
        use_attribute_docstrings=True,
        json_schema_extra=_on_one_line,
    )


class Described(Protocol):
    """What a person chooses by."""

    @property
    def name(self) -> str:
        """The name in its registry."""
        ...

    @property
    def source(self) -> str:
        """Where it comes from: author, year, chapter."""
        ...

    @property
    def description(self) -> str:
        """One sentence for a person who chooses."""
        ...


class Named(Described, Protocol):
    """What is chosen with options: methods, solvers and positionings alike."""

    @property
    def options_model(self) -> type[OptionsModel]:
        """The options, each with its unit, range and default."""
        ...


@dataclass(frozen=True, eq=False)
class Registered:
    """Marks a string option, in ``Annotated``, as a name that ``registry`` holds; the refusal lists those."""

    registry: Registry[Any]

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Check the name after the string."""
        return core_schema.no_info_after_validator_function(self._check, handler(source))

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        """The names, as those of an enumeration."""
        return {**handler(schema), "enum": list(self.registry)}

    def _check(self, name: str) -> str:
        try:
            self.registry[name]
        except UnknownNameError as error:
            raise ValueError(str(error)) from None
        return name


@dataclass(frozen=True)
class OptionFacts:
    """What a person must know of an option: default, what is allowed ("ch2, ch3", "> 0", "0 to 10"), meaning."""

    default: Any
    allowed: str
    description: str


def option_facts(model: type[BaseModel]) -> dict[str, OptionFacts]:
    """The facts of every option, by name."""
    schemas = model.model_json_schema().get("properties", {})
    return {
        name: OptionFacts(
            field.get_default(call_default_factory=True),
            _allowed(schemas[name]),
            schemas[name].get("description", ""),
        )
        for name, field in model.model_fields.items()
    }


def _allowed(schema: dict[str, Any]) -> str:
    """Names or range of a JSON schema, in words; ``null`` is left out, since the default says it."""
    if "anyOf" in schema:
        return next(_allowed(part) for part in schema["anyOf"] if part.get("type") != "null")
    if "enum" in schema or "const" in schema:
        return ", ".join(map(str, schema.get("enum") or [schema["const"]]))
    if schema.get("type") == "boolean":
        return "true, false"
    low, high = schema.get("minimum"), schema.get("maximum")
    above, below = schema.get("exclusiveMinimum"), schema.get("exclusiveMaximum")
    parts = [f"≥ {low:g}" if low is not None else "", f"> {above:g}" if above is not None else ""]
    parts += [f"≤ {high:.10g}" if high is not None else "", f"< {below:g}" if below is not None else ""]
    return ", ".join(part for part in parts if part)
