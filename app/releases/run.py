"""Makes an edition: examines, tells, solves, serves. Whatever is broken off, the next one goes on from there."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from datetime import UTC, date, datetime, timedelta

from app.changes.store import begin_epoch, prune
from app.core.caller import EDITION, TOLD, read_edition
from app.core.db import Sessions, make_engine, session_factory
from app.core.messages import say
from app.core.settings import Settings
from app.map.derived.following import follow_all
from app.network import ZOOM
from app.network.locks import releasing_alone
from app.network.marks import waiting_cells
from app.network.swap import publish_cells
from app.releases import serving, store
from app.releases.files import publish_files
from app.releases.keeping import drop_files
from app.releases.store import Edition
from app.releases.telling import examine, tell
from fusion.errors import FusionError
from fusion.types import Progress, no_progress

BLOCK_LEVELS = 3
"""Cells are solved together by tiles of so many zooms further out: 8 by 8 of them."""


class BusyReleaseError(FusionError):
    """Another edition is being made just now."""

    kind = "release-under-way"


def today() -> date:
    """The day that it is (UTC)."""
    return datetime.now(UTC).date()


def release(
    url: str, settings: Settings, *, day: date | None = None, progress: Progress = no_progress
) -> Edition:
    """Make the next edition, of today or of ``day``, and serve it.

    Raises ``BusyReleaseError`` where another is being made.
    """
    with _sessions(url, settings) as (live, told, edition), releasing_alone(live) as alone:
        if not alone:
            raise BusyReleaseError(say("release.being_made"))
        needed = settings.owners_needed
        examine(live, progress)
        tell(live, needed, progress, alone.require)
        solve(told, progress)
        progress("serving", 0.0)
        begin_epoch(edition)
        with edition.begin() as session:
            alone.require(session)
            of_day = day or today()
            serving.serve(session, needed, of_day)
            number = serving.add_edition(
                session, day=of_day, owners=settings.public_owners, owners_needed=needed
            )
        follow_all(edition)
        prune(edition, settings.changes_kept_days)
        progress("serving", 1.0)
        with live() as session:
            made = store.get_edition(session, number)
        assert made is not None  # noqa: S101 - it was just added, and nobody else adds or takes away
        return publish_files(live, edition, made, settings, progress)


def add_files(url: str, settings: Settings, progress: Progress = no_progress) -> Edition | None:
    """Write the files of the newest edition where whoever made it was cut off before; None: it has them."""
    with _sessions(url, settings) as (live, _, edition), releasing_alone(live) as alone:
        with live() as session:
            latest = store.latest_edition(session)
        if latest is None or latest.files or not alone:
            return None
        return publish_files(live, edition, latest, settings, progress)


def solve(told: Sessions, progress: Progress = no_progress) -> None:
    """Solve what was marked, a block of cells at a time: sums cost a solution little, and its edge is what costs."""
    with told() as session:
        cells = [one.cell for one in waiting_cells(session)]
    blocks: dict[int, list[int]] = {}
    for cell in cells:
        blocks.setdefault(cell_block(cell), []).append(cell)
    for done, block in enumerate(sorted(blocks)):
        progress("slopes", done / len(blocks))
        publish_cells(told, blocks[block])
    progress("slopes", 1.0)


def cell_block(cell: int) -> int:
    """The tile of zoom ``ZOOM`` - ``BLOCK_LEVELS`` around a cell, as a number."""
    side = ZOOM - BLOCK_LEVELS
    return cell >> (ZOOM + BLOCK_LEVELS) << side | (cell & ((1 << ZOOM) - 1)) >> BLOCK_LEVELS


def is_due(sessions: Sessions, settings: Settings) -> bool:
    """Whether the public is to have another edition by now."""
    if settings.shown_map != "releases":
        return False
    with sessions() as session:
        latest = store.latest_edition(session)
    return latest is None or today() >= latest.day + timedelta(days=settings.release_days)


def lacks_files(sessions: Sessions, settings: Settings) -> bool:
    """Whether the newest edition has no files yet."""
    with sessions() as session:
        latest = store.latest_edition(session)
    return settings.shown_map == "releases" and latest is not None and not latest.files


def in_words(edition: Edition) -> str:
    """An edition in one sentence."""
    withheld = edition.withheld_length_share
    figures = {"length_km": edition.length_m / 1000, "owners": edition.owners_needed}
    return say(
        "release.edition",
        n=edition.number,
        day=edition.day.isoformat(),
        segments=edition.segments,
        **figures,
        kept_back="" if withheld is None else say("release.kept_back", share=withheld),
    )


def forget_where_removed(sessions: Sessions, settings: Settings) -> bool:
    """Where the public reads no editions, keep nothing of them once a drive is removed that was told."""
    if settings.shown_map == "releases":
        return False
    with sessions() as session:
        removed = serving.any_removed(session)
    return removed and forget(sessions, settings)


def forget(sessions: Sessions, settings: Settings) -> bool:
    """Keep nothing of editions: the service makes none. Whether there was anything."""
    with releasing_alone(sessions) as alone:
        if not alone:
            return False
        with sessions.begin() as session:
            alone.require(session)
            read_edition(session)  # triggers of its tables write to what is called so there
            editions = store.list_editions(session)
            forgotten = serving.forget_all(session)
        drop_files(settings, editions)
        return forgotten


@contextmanager
def _sessions(url: str, settings: Settings) -> Iterator[tuple[Sessions, Sessions, Sessions]]:
    """Of the live tables, of what is told, of what is served."""
    with ExitStack() as stack:
        engines = [
            make_engine(url, background=True, schema=schema, pooled=settings.database_pooled)
            for schema in (None, TOLD, EDITION)
        ]
        for engine in engines:
            stack.callback(engine.dispose)
        live, told, edition = map(session_factory, engines)
        yield live, told, edition
