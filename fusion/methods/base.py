"""What a method is: the protocol, the registry that it goes by, what it returns, and what its options are made of.

Each method is a file of its own, and ``fusion.catalogue`` puts them into the registry; known here are only the names of
those that lean on the elevation model (``OF_TERRAIN``), which a new one of that kind joins.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any, Protocol

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    SerializerFunctionWrapHandler,
    field_validator,
    model_serializer,
)
from pydantic_core import CoreSchema, core_schema

from fusion.errors import BadOptionsError, UnknownNameError
from fusion.gnss.positioning import POSITIONINGS
from fusion.network.pass_factor import PassFactor
from fusion.registry import DEFAULT_POSITIONING, Registry, check_columns
from fusion.roads.network import RoadNetwork
from fusion.terrain.dem import Dem
from fusion.types import DrawnMeasurements, DriveLog, Progress, SegmentSlope, Track


class Method(Protocol):
    """A named estimator: a drive log and its surroundings in, a track and segment slopes out."""

    @property
    def name(self) -> str:
        """The name in ``METHODS``."""
        ...

    @property
    def source(self) -> str:
        """Where the method comes from: author, year, chapter."""
        ...

    @property
    def description(self) -> str:
        """One sentence for a person who chooses."""
        ...

    @property
    def needs(self) -> tuple[str, ...]:
        """What the log and its surroundings must have, in words."""
        ...

    @property
    def cues(self) -> tuple[str, ...]:
        """Which of ``fusion.types.CUES`` its slopes can be made of; none: they are the elevation model's."""
        ...

    @property
    def options_model(self) -> type[Options]:
        """The options, each with its unit, range and default."""
        ...

    def estimate(
        self, log: DriveLog, network: RoadNetwork, dem: Dem | None, options: Any, progress: Progress
    ) -> DriveResult:
        """Estimate the slopes of the segments that were driven.

        ``options`` is an instance of ``options_model``. The result depends on the arguments alone: the same
        log, roads, terrain and options give the same numbers on any number of threads. Raises
        ``MissingSensorError`` where the log lacks what the method needs, ``NoMatchError`` where no epoch
        comes near a road.
        """
        ...


METHODS: Registry[Method] = Registry("method")
"""Filled by ``fusion.catalogue``."""

OF_TERRAIN = ("dem", "ukf-dem")
"""Methods whose slopes are the elevation model's, or lean on it: the same model counts once, however many drive."""


@dataclass(frozen=True)
class DriveResult:
    """Everything a method says about a drive. ``report`` is JSON-serialisable.

    ``factors``: what the drive contributes to the network adjustment, one a pass; empty for methods that give only
    slopes. ``measurements``: what the estimate is drawn over, where the method offers it.
    """

    track: Track
    slopes: tuple[SegmentSlope, ...]
    report: dict[str, Any]
    factors: tuple[PassFactor, ...] = ()
    measurements: DrawnMeasurements | None = None
    late_by: Callable[[float], tuple[PassFactor, ...]] | None = None
    """The factors anew if the log's altimeter is so many seconds late, where it has one"""


@dataclass(frozen=True)
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


class Options(BaseModel):
    """Base of every method's options: immutable, unknown names refused, each field described with its unit.

    How positions are computed is every method's to be told; it is done before the method sees the log.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    gnss: Annotated[str, Registered(POSITIONINGS)] = Field(
        default=DEFAULT_POSITIONING,
        description="How positions are computed; all but receiver and auto need raw pseudoranges.",
    )
    gnss_options: dict[str, Any] = Field(
        default_factory=dict, description="Options of that positioning, by name."
    )
    columns: dict[str, str] = Field(
        default_factory=dict,
        description="Columns of a CSV by other names: Versant's name -> the header's.",
    )

    @field_validator("columns")
    @classmethod
    def _columns_of_ours(cls, columns: dict[str, str]) -> dict[str, str]:
        try:
            check_columns(columns)
        except BadOptionsError as error:
            raise ValueError(str(error)) from None
        return columns

    @model_serializer(mode="wrap")
    def _without_idle_columns(self, dump: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Names of columns are the file's affair: of a file without any, runs note what they always did."""
        out: dict[str, Any] = dump(self)
        if not out["columns"]:
            del out["columns"]
        return out


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
            field.get_default(call_default_factory=True), _allowed(schemas[name]), field.description or ""
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
