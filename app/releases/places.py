"""The circles around what an owner's drives do not tell: his zones, and the places where his trips end.

A place has one radius, whoever asks: editions, which keep it, and files of a drive, which write nothing.
"""

from __future__ import annotations

from collections.abc import Callable

from sqlalchemy.orm import Session

from app.releases import store
from app.releases.ends import SAME_PLACE_M, Circle, apart, distance_m
from fusion.types import Floats


class Places:
    """The places and zones of owners, each owner's read once."""

    def __init__(self, session: Session, keep: Callable[[int, Circle], None] | None = None) -> None:
        """``keep``: takes a place that was not known, and its owner."""
        self._session = session
        self._keep = keep
        self._places: dict[int, list[Circle]] = {}
        self._zones: dict[int, list[Circle]] = {}

    def around(self, owner_id: int, ends: Floats) -> list[Circle]:
        """The circles around these ends of an owner's trip, degrees, shape (n, 2), and his zones."""
        if owner_id not in self._places:
            self._places[owner_id] = store.places(self._session, owner_id)
            self._zones[owner_id] = store.zones(self._session, owner_id)
        return [*(self._circle(owner_id, *end) for end in apart(ends)), *self._zones[owner_id]]

    def _circle(self, owner_id: int, lon_deg: float, lat_deg: float) -> Circle:
        # The first that is near, not the nearest: places that come later change nothing then.
        for known in self._places[owner_id]:
            if distance_m(lon_deg, lat_deg, known.lon_deg, known.lat_deg) <= SAME_PLACE_M:
                return known
        share = store.place_share(self._session, owner_id, lon_deg, lat_deg)
        circle = Circle.drawn(lon_deg, lat_deg, share)
        self._places[owner_id].append(circle)
        if self._keep is not None:
            self._keep(owner_id, circle)
        return circle
