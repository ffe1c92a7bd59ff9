"""What a method is: the protocol, the registry that it goes by, what it returns, and what its options are made of.

Each method is a file of its own, and ``fusion.catalogue`` puts them into the registry; known here are only the names of
those that lean on the elevation model (``OF_TERRAIN``), which a new one of that kind joins.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal, Protocol

import numpy as np
from pydantic import Field, SerializerFunctionWrapHandler, field_validator, model_serializer

from fusion.errors import BadOptionsError
from fusion.gnss.positioning import POSITIONINGS
from fusion.network.pass_columns import table_of
from fusion.network.pass_factor import PassFactor
from fusion.options import Named, OptionsModel, Registered
from fusion.registry import DEFAULT_POSITIONING, Registry, check_columns
from fusion.roads.network import RoadNetwork
from fusion.terrain.dem import Dem
from fusion.types import DrawnMeasurements, DriveLog, Ints, Progress, SegmentSlope, Track


class Method(Named, Protocol):
    """A named estimator: a drive log and its surroundings in, a track and segment slopes out."""

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
    factors: Sequence[PassFactor] = ()
    measurements: DrawnMeasurements | None = None
    late_by: Callable[..., Sequence[PassFactor]] | None = None
    """``late_by(lag_s)``, or ``late_by(lag_s, progress)``: the factors anew if the log's altimeter is so many seconds
    late, where it has one"""

    @property
    def in_network(self) -> Ints:
        """The segments of its factors, ascending."""
        return np.unique(table_of(self.factors).segment)


class Options(OptionsModel):
    """Base of every method's options.

    How positions are computed is every method's to be told; it is done before the method sees the log.
    """

    gnss: Annotated[str, Registered(POSITIONINGS)] = Field(default=DEFAULT_POSITIONING)
    """How positions are computed; all but receiver and auto need raw pseudoranges."""
    gnss_options: dict[str, Any] = Field(default_factory=dict)
    """Options of that positioning, by name."""
    columns: dict[str, str] = Field(default_factory=dict)
    """Columns of a CSV by other names: Versant's name -> the header's, or - where the file has no such column."""
    heights: Literal["as-logged", "ellipsoid"] = "as-logged"
    """What the log's altitudes are: as-logged: what it calls them, ellipsoid: heights above the WGS 84 ellipsoid,
    whatever it calls them, which a geoid turns into altitudes above the sea where one is installed (EGM2008, EGM96)."""

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
        """What columns and heights are is the file's affair: where nobody says it, runs note what they always did."""
        out: dict[str, Any] = dump(self)
        for name in ("columns", "heights"):
            if out[name] == type(self).model_fields[name].get_default(call_default_factory=True):
                del out[name]
        return out
