"""What Prometheus scrapes: requests as they are answered, drives and queue as they stand at each scrape, and what
workers and imports have counted (``app.core.telemetry``)."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from math import nan

from fastapi import APIRouter, Request, Response
from prometheus_client import CollectorRegistry, Counter, Histogram
from prometheus_client import metrics_core as families
from prometheus_client.exposition import CONTENT_TYPE_LATEST, generate_latest
from prometheus_client.registry import Collector
from sqlalchemy.orm import Session

from app.core.http import text_answer
from app.core.standby.use import Standby
from app.core.tables import DRIVE_STATUSES
from app.core.telemetry.ledger import totals_of_all
from app.core.telemetry.measures import MEASURES, Measure, Totals
from app.network.cells import data_version
from app.ops import store

BUCKETS_S = (0.002, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 5.0, 10.0, 60.0)
LABELS = {
    "versant_http_requests_total": ("method", "route", "status"),
    "versant_http_request_duration_seconds": ("method", "route"),
    "versant_uploads_refused_total": ("quota",),
    "versant_drives": ("status",),
    "versant_failures": ("kind",),
}
"""Of those that are not counted by ``app.core.telemetry.measures``."""
GAUGES = {
    "queue_depth": "Drives that wait.",
    "queue_oldest_wait_seconds": "How long the drive at the head of the queue has waited; 0 while none waits.",
    "data_version": "Number of the published data.",
    "cells_waiting": "Cells of the map that wait to be solved.",
    "cells_unsolved": "Cells of the map that solvers repeatedly failed to solve; /v1/admin/stats names them.",
    "squares_waiting": "Former name of versant_cells_waiting.",
    "squares_unsolved": "Former name of versant_cells_unsolved.",
    "derived_behind_seconds": "How long the oldest change of segments has waited to be shown by ways and low zooms; "
    "0 while none waits.",
    "workers": "Processes that take drives from the queue and are alive.",
}
"""Gauges without labels: what stands behind ``versant_`` in their names, and their meaning."""
STANDBY = {
    "standby_used": "1 while the map is read from the standby, 0 while it is read from the primary.",
    "standby_lag_seconds": "How old the map on the standby is at most; NaN while nobody knows.",
    "standby_passed_on": "Requests that the primary answered because the standby failed at them, since its start.",
}
"""Where VERSANT_DATABASE_READ_URL names a standby, without labels, of the process."""
METHODS = frozenset({"GET", "HEAD", "POST", "DELETE", "OPTIONS", "PUT", "PATCH"})

EXAMPLE = 'versant_drives{status="done"} 12.0\n'

router = APIRouter(tags=["operation"])


@router.get(
    "/metrics",
    summary="Prometheus metrics",
    response_class=Response,
    responses={200: text_answer("text/plain", "Text exposition format.", EXAMPLE)},
)
def metrics(request: Request) -> Response:
    """Requests by route and status with their durations, drives by status, the queue, and what workers count and time:
    stages of drives, solutions, waits for locks, failures by kind, imports.
    """
    exposition = generate_latest(request.app.state.metrics.registry)
    return Response(exposition, headers={"Content-Type": CONTENT_TYPE_LATEST})


@dataclass(frozen=True)
class Gauges:
    """Figures of one moment."""

    drives_by_status: dict[str, int]
    failures_by_kind: dict[str, int]
    plain: dict[str, float]
    """By the names of ``GAUGES``"""
    totals: Totals


def read_gauges(session: Session) -> Gauges:
    """The figures of this moment."""
    queue, cells = store.queue(session), store.waiting_cells(session)
    plain = {
        "queue_depth": queue.depth,
        "queue_oldest_wait_seconds": queue.oldest_wait_s or 0.0,
        "data_version": data_version(session),
        "cells_waiting": cells.waiting,
        "cells_unsolved": cells.unsolved,
        "squares_waiting": cells.waiting,
        "squares_unsolved": cells.unsolved,
        "derived_behind_seconds": store.behind(session).behind_s or 0.0,
        "workers": store.workers(session),
    }
    return Gauges(
        store.drives_by_status(session), store.failures_by_kind(session), plain, totals_of_all(session)
    )


class Metrics(Collector):
    """One application's registry; two applications in a process do not meet in it."""

    def __init__(self, read_gauges: Callable[[], Gauges | None]) -> None:
        """``read_gauges`` is called at each scrape and returns None while the database does not answer."""
        self.registry = CollectorRegistry()
        requests, seconds = "versant_http_requests_total", "versant_http_request_duration_seconds"
        refused = "versant_uploads_refused_total"
        self._requests = Counter(requests, "Requests answered.", LABELS[requests], registry=self.registry)
        self._seconds = Histogram(
            seconds,
            "Time from a request to the last byte of its answer.",
            LABELS[seconds],
            buckets=BUCKETS_S,
            registry=self.registry,
        )
        self._refused = Counter(
            refused,
            "Uploads refused because a quota of their owner was used up.",
            LABELS[refused],
            registry=self.registry,
        )
        self.standby: Standby | None = None
        """Of the process; None: all is read from the primary."""
        self._read_gauges = read_gauges
        self.registry.register(self)

    def observe(self, method: str, route: str, status: int, seconds: float) -> None:
        """Count one request."""
        verb = method if method in METHODS else "other"  # anyone can invent methods, and each is a series
        self._requests.labels(verb, route, str(status)).inc()
        self._seconds.labels(verb, route).observe(seconds)

    def refused(self, quota: str) -> None:
        """Count an upload that was refused by that quota; whose it was is nobody's to read."""
        self._refused.labels(quota).inc()

    def collect(self) -> Iterator[families.Metric]:
        """The figures of this moment; only ``versant_database_up 0`` while there is no database."""
        if self.standby is not None:
            yield from _of_standby(self.standby)
        gauges = self._read_gauges()
        yield families.GaugeMetricFamily(
            "versant_database_up", "1 while the database answers.", value=float(gauges is not None)
        )
        if gauges is None:
            return
        by_status = {status: gauges.drives_by_status.get(status, 0) for status in DRIVE_STATUSES}
        yield _by_label("versant_drives", "Drives by status.", by_status)
        for name, meaning in GAUGES.items():
            yield families.GaugeMetricFamily(f"versant_{name}", meaning, value=gauges.plain[name])
        failures = "Drives that are failed now, by the kind of the failure."
        yield _by_label("versant_failures", failures, gauges.failures_by_kind)
        yield from (_family(measure, gauges.totals) for measure in MEASURES)


def _by_label(name: str, meaning: str, counts: dict[str, int]) -> families.Metric:
    family = families.GaugeMetricFamily(name, meaning, labels=LABELS[name])
    for label, count in counts.items():
        family.add_metric([label], count)
    return family


def _of_standby(standby: Standby) -> Iterator[families.Metric]:
    lag_s = standby.lag_s
    values = (float(standby.used), nan if lag_s is None else lag_s, float(standby.passed_on))
    for (name, meaning), value in zip(STANDBY.items(), values, strict=True):
        yield families.GaugeMetricFamily(f"versant_{name}", meaning, value=value)


def _family(measure: Measure, totals: Totals) -> families.Metric:
    """What all processes have counted of one measure."""
    series = measure.series(totals)
    if not measure.buckets:
        counter = families.CounterMetricFamily(measure.name, measure.meaning, labels=measure.labels)
        for values, parts in series.items():
            counter.add_metric(values, parts[""])
        return counter
    histogram = families.HistogramMetricFamily(measure.name, measure.meaning, labels=measure.labels)
    for values, parts in series.items():
        histogram.add_metric(values, *measure.cumulative(parts))
    return histogram
