"""What an update of the service leaves to be done: drives computed again, heights filled in, remains cleared away.

A migration marks what its model cannot use any more and the workers see to the rest, at their start and again and
again. All of it may be cut off at any moment and done twice.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator

from app.core.db import Sessions
from app.core.settings.places import FilePlace
from app.drives.batches.enqueuing import give_jobs
from app.network.marks import append_marks
from app.network.publish import left_over
from app.terrain.files import add_bounds
from app.terrain.heights import fill_heights, renewing

logger = logging.getLogger(__name__)


def renew(sessions: Sessions) -> None:
    """Give jobs and clear away: what takes no time to speak of."""
    if count := give_jobs(sessions):
        logger.info(
            "%d drives are computed again, behind uploads; GET /v1/drives/reprocess tells how far", count
        )
    if count := clear_remains(sessions):
        logger.info("%d segments lose a slope that no drive stands behind any more", count)


class HeightFiller:
    """Fills heights of the elevation model in, a piece at each call: of a country that takes minutes.

    First those that a change of the rasters left to be renewed, whose maker may be gone, then those of before heights
    were kept. Drives do not wait for it. The roads of each are filled in before it is solved
    (``fill_heights_along``).
    """

    def __init__(self, sessions: Sessions, dem_dir: FilePlace) -> None:
        self._sessions, self._dem_dir, self._after_id = sessions, dem_dir, 0
        self._renewing: Iterator[float] = iter(())
        self._knows_bounds = False

    def piece(self) -> bool:
        """The next piece; whether there may be more."""
        if not self._knows_bounds:
            add_bounds(self._sessions, self._dem_dir)
            self._knows_bounds = True
        if next(self._renewing, None) is not None:
            return True
        self._renewing = renewing(self._sessions, self._dem_dir, wait=False)
        if next(self._renewing, None) is not None:
            return True
        last = fill_heights(self._sessions, self._dem_dir, self._after_id)
        if last is None and self._after_id:
            logger.info("heights of the elevation model are filled in")
        self._after_id = last or 0
        return last is not None


def clear_remains(sessions: Sessions) -> int:
    """Let what is published of a former model and no drive is about to say again go; of how many segments."""
    with sessions.begin() as session:
        remains = left_over(session)
        append_marks(session, (), remains)
    return len(remains)
