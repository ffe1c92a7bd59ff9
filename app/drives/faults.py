"""Why a run has no result, in words for the person who uploaded the log. Knows no database."""

from __future__ import annotations

import logging
import uuid
from typing import NamedTuple

from app.core.telemetry.logs import blanked
from app.jobs.memory import MORE_MEMORY
from fusion.errors import FusionError

logger = logging.getLogger(__name__)


class ProcessingError(FusionError):
    """The service, not the log, is the reason that a drive fails."""

    kind = "processing-failed"


class NoRoadsError(ProcessingError):
    """There are no roads at all yet."""

    kind = "no-roads"


class Fault(NamedTuple):
    """The kind of a failure, its reason, and the line, byte or field at fault."""

    kind: str
    reason: str
    where: str | None = None


def fault_of(error: Exception, what: str, number: uuid.UUID, stage: str) -> Fault:
    """What is said of an error in a run of ``what`` (drive, trial); what is the service's fault is logged as well."""
    if isinstance(error, FusionError):
        return Fault(error.kind, blanked(str(error)), error.where)
    if isinstance(error, MemoryError):
        logger.error("%s %s: out of memory in stage %s", what, number, stage)
        reason = f"The drive needs {MORE_MEMORY}. Split the log into shorter drives."
        return Fault("out-of-memory", reason)
    logger.error("%s %s failed unexpectedly in stage %s", what, number, stage, exc_info=error)
    return Fault(
        "internal",
        f"Processing failed in stage '{stage}' by a fault of the service, not of the log "
        f"({type(error).__name__}). It is in the worker's log under the {what}'s id; ask the operator.",
    )
