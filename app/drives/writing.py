"""What a run of a drive found, written to the database: in one transaction, with marks of what has to be solved for it
(``publishing``)."""

from __future__ import annotations

import uuid
from collections.abc import Callable
from dataclasses import replace
from functools import partial

from sqlalchemy.orm import Session

from app.core.db import Sessions
from app.core.version import code_version
from app.drives import claims, publishing, queue, tracks
from app.drives.computing import Computed
from app.drives.documents import Drive
from app.jobs.context import JobContext
from app.jobs.requests.run import Discarded
from app.network import results as slopes
from app.network.cells import road_states
from app.network.locks import WantedError, give_way
from app.network.marks import MarkedBy
from app.network.solve import lag_among_all
from fusion.lags import LAG_ROUNDS, factors_for_lag
from fusion.methods.base import DriveResult
from fusion.network.pass_columns import PACKED_AT_ONCE
from fusion.pipeline import parse_options
from fusion.types import Ints, Progress


def append(context: JobContext, drive: Drive, computed: Computed, *, behind: bool) -> bool:
    """Write all that the drive says in one transaction; False when the roads around it changed since they were read.

    That of a million positions takes half a minute, in which its row is held. Whoever wants that, to remove the drive
    above all, is let in once; then it is written to the end if it is still wanted.
    """

    def write(look: Callable[[Session], None]) -> bool:
        with context.sessions.begin() as session:
            delay_s = publishing.patience_s(session, context.settings.publish_every_s, behind=behind)
            return write_result(session, drive, computed, delay_s, partial(look, session))

    try:
        return write(give_way)
    except WantedError:
        with context.sessions.begin() as session:
            if not claims.lock_running(session, drive.id, drive.generation):
                raise Discarded from None
        return write(lambda _: None)


def write_result(
    session: Session,
    drive: Drive,
    computed: Computed,
    delay_s: float,
    look: Callable[[], None] = lambda: None,
) -> bool:
    """Write all that a running drive says in the session's transaction, and mark its cells to be solved within that.

    ``look`` is called between its parts, and may raise.

    False, and nothing is written, where the roads around it changed since they were read. Raises ``Discarded`` where
    the drive was deleted or asked for anew.
    """
    around, ids, result, facts = computed.around, computed.ids, computed.result, computed.facts
    provenance = slopes.RunProvenance(
        method=drive.method,
        options=parse_options(drive.method, drive.options).model_dump(mode="json"),
        code_version=code_version(),
        road_version_id=around.version_id,
        road_state=max(around.roads.states.values(), default=0),
        dem_version_id=around.dem_version_id,
    )
    track = tracks.EncodedTrack.of(result.track, ids, result.measurements)
    slopes.begin_change(session, drive.id, slopes.in_database(result.factors, ids))
    if not claims.lock_running(session, drive.id, drive.generation):
        raise Discarded
    if road_states(session, around.roads.states) != around.roads.states:
        return False
    tracks.save_track(session, drive.id, track)
    look()
    slopes.append_result(
        session,
        MarkedBy(drive.id, drive.generation),
        ids,
        result.slopes,
        provenance,
        result.factors,
        facts.epoch_s,
        delay_s=delay_s,
        look=look,
    )
    look()
    claims.mark_publishing(
        session,
        drive.id,
        report=computed.report(),
        bounds=facts.bounds_deg,
        epochs=len(result.track),
        distance_m=result.report["distance_m"],
        drive_time=facts.drive_time,
    )
    queue.enqueue_solve(session)
    return True


def with_settled_lag(
    sessions: Sessions,
    drive_id: uuid.UUID,
    segment_ids: Ints,
    result: DriveResult,
    progress: Progress | None = None,
) -> DriveResult:
    """The result with its factors made anew for the lag that the stored network finds; most results as they are.

    How late the altimeter is follows from all drives (``fusion.lags.factors_for_lag``, as for logs at hand). It is
    found before the network is owned: others go on publishing meanwhile. Of a long drive its beginning tells it.

    ``segment_ids`` maps the segments of the result's factors to the database's ids.
    """
    factors = result.factors
    if result.late_by is None or not factors:
        return result
    for _ in range(LAG_ROUNDS - 1):
        with sessions() as session:
            beginning = factors[:PACKED_AT_ONCE]
            lag = lag_among_all(session, drive_id, slopes.in_database(beginning, segment_ids))
        anew = factors_for_lag(result, factors, lag, progress=progress)
        if anew is None:
            break
        factors = anew
    return replace(result, factors=factors)
