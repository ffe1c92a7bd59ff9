"""A trial is a run of a drive that does not publish: the same steps (``app.drives.computing``), and a result beside it.

No pass, no mark, no slope is written, so that nothing of it can reach the map. Runs begin and end as
``app.jobs.requests.run`` says. Knows no HTTP.
"""

from __future__ import annotations

import logging
import time

from app.core.telemetry import tracing
from app.core.telemetry.logs import about, tell
from app.drives import tracks
from app.drives.computing import Computed, RunProgress, compute, failure_of
from app.drives.trials import store
from app.drives.trials.documents import Trial
from app.drives.trials.store import encode_slopes, trials
from app.jobs.requests.run import Discarded, RequestKind, RequestRun
from app.jobs.requests.store import Failure
from app.jobs.task import is_connection_loss

logger = logging.getLogger(__name__)


def _run_trial(run: RequestRun[Trial]) -> str:
    """Compute the trial; a word on how it ended."""
    began_s, trial = time.monotonic(), run.request
    progress = RunProgress(run.show)

    def keep(computed: Computed) -> bool:
        progress.begin("saving")
        result, ids = computed.result, computed.ids
        with run.computing():
            columns = {
                "report": computed.report(),
                "track": tracks.encode(result.track, ids),
                "measurements": result.measurements and tracks.encode_measurements(result.measurements),
                "slopes": encode_slopes(result.slopes, ids),
            }
        with run.sessions.begin() as session:
            if not trials.finish(session, trial, **columns):
                raise Discarded
        return True

    with about(drive=trial.drive_id), tracing.span("trial", method=trial.method) as span:
        compute(run.context, trial, progress, run.computing, keep)
        span.note(outcome="done")
    tell(logger, "trial done", method=trial.method, seconds=round(time.monotonic() - began_s, 3))
    return "done"


def _failure(error: Exception, run: RequestRun[Trial]) -> Failure | None:
    """What the log or the method is to blame for, and faults of the service; None: the database was lost."""
    if is_connection_loss(error):
        return None
    return failure_of(error, "trial", run.request.id, run.progress.stage or "reading")


TRIAL = RequestKind(
    trials,
    _run_trial,
    advice="Choose a method or options that take less, or split the log into shorter drives.",
    failure=_failure,
    folder="trials",
    private=True,
    expire=store.expire,
)
"""What a worker does for trials."""
