"""What a method is: the protocol, the registry, and options every method shares."""

from __future__ import annotations

from typing import Any, Protocol

from pydantic import BaseModel, ConfigDict

from fusion.registry import Registry
from fusion.roads.network import RoadNetwork
from fusion.terrain.dem import Dem
from fusion.types import DriveLog, DriveResult, Progress


class Options(BaseModel):
    """Base of every method's options: immutable, unknown names refused, each field described with its unit."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


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
