"""What anybody reads of the service over HTTP: what stands there of each segment, and which segments changed."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import httpx
import numpy as np

from fusion.types import Bools, Floats, Ints

ITEMS = "/collections/segments/items"
PAGE = 10_000
PROPERTIES = ("drives", "observations", "slope_percent", "slope_sigma_percent")


@dataclass(frozen=True, eq=False)
class Seen:
    """What stands of each row of the roads: NaN and 0 where nothing does."""

    drives: Ints
    observations: Ints
    slope: Floats
    sigma: Floats

    @classmethod
    def nothing(cls, size: int) -> Seen:
        """Of roads that nobody has driven."""
        zero, unknown = np.zeros(size, np.int64), np.full(size, np.nan)
        return cls(zero, zero.copy(), unknown, unknown.copy())

    @property
    def told(self) -> Bools:
        """Of which rows anything stands there that was driven."""
        return self.drives > 0


@dataclass
class Eyes:
    """Somebody without a key who looks again and again."""

    client: httpx.Client
    ids: Ints
    """The service's number of each row, ascending or not."""
    _since: str | None = None
    _order: Ints = field(init=False)

    def __post_init__(self) -> None:
        self._order = np.argsort(self.ids)

    def everything(self) -> Seen:
        """All that stands there."""
        seen = Seen.nothing(len(self.ids))
        self._read(seen, {"driven": "true"})
        return seen

    def begin(self) -> Seen:
        """All that stands there, to go on from by ``changes``."""
        self._since = self._json("/v1/changes", {})["version"]
        return self.everything()

    def changes(self, before: Seen) -> Seen:
        """What stands there now, by what the service says has changed."""
        seen = replace(before, **{name: value.copy() for name, value in vars(before).items()})
        version = str(self._since)
        self._since = self._json("/v1/changes", {})["version"]
        self._read(seen, {"updated_since": version})
        return seen

    def _read(self, seen: Seen, query: dict[str, str]) -> None:
        wanted = {**query, "limit": str(PAGE), "skipGeometry": "true", "properties": ",".join(PROPERTIES)}
        page = self._json(ITEMS, wanted)
        while True:
            self._keep(seen, page["features"])
            further = [link["href"] for link in page["links"] if link["rel"] == "next"]
            if not further:
                return
            page = self._json(further[0], None)

    def _keep(self, seen: Seen, features: list[dict[str, Any]]) -> None:
        if not features:
            return
        ids = np.array([feature["id"] for feature in features])
        rows = self._order[np.searchsorted(self.ids, ids, sorter=self._order)]
        columns = [[feature["properties"][name] for feature in features] for name in PROPERTIES]
        drives, observations, slope, sigma = (np.array(column, float) for column in columns)
        driven = drives > 0
        seen.drives[rows], seen.observations[rows] = drives, observations
        seen.slope[rows] = np.where(driven, slope, np.nan)
        seen.sigma[rows] = np.where(driven, sigma, np.nan)

    def _json(self, path: str, query: dict[str, str] | None) -> Any:
        answer = self.client.get(path, params=query)
        answer.raise_for_status()
        return answer.json()
