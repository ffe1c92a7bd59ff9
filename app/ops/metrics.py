"""What happens to every request: HEAD as GET without a body, no changes from other sites, counting."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

from prometheus_client import CollectorRegistry, Counter, Histogram
from prometheus_client.exposition import CONTENT_TYPE_LATEST, generate_latest
from prometheus_client.metrics_core import GaugeMetricFamily, Metric
from prometheus_client.registry import Collector
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from app.core.tables import DRIVE_STATUSES
from app.ops.store import Gauges


class MetricsMiddleware:
    """Counts and times every request by method, route template and status."""

    def __init__(self, app: ASGIApp, metrics: Metrics) -> None:
        self.app = app
        self.metrics = metrics

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Observe one request; the time ends with the last byte of the answer."""
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        status, started = 500, time.perf_counter()

        async def seen(message: Message) -> None:
            nonlocal status
            if message["type"] == "http.response.start":
                status = message["status"]
            await send(message)

        try:
            await self.app(scope, receive, seen)
        finally:
            # The template and not the path: a series per drive would never end.
            template = getattr(scope.get("route"), "path", "(no route)")
            self.metrics.observe(scope["method"], template, status, time.perf_counter() - started)


CONTENT_TYPE = CONTENT_TYPE_LATEST
BUCKETS_S = (0.002, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 5.0, 10.0, 60.0)
METHODS = frozenset({"GET", "HEAD", "POST", "DELETE", "OPTIONS", "PUT", "PATCH"})


class Metrics:
    """One application's registry; two applications in a process do not meet in it."""

    def __init__(self, read_gauges: Callable[[], Gauges | None]) -> None:
        """``read_gauges`` is called at each scrape and returns None while the database does not answer."""
        self.registry = CollectorRegistry()
        labels = ("method", "route", "status")
        self._requests = Counter(
            "versant_http_requests", "Requests answered.", labels, registry=self.registry
        )
        self._seconds = Histogram(
            "versant_http_request_duration_seconds",
            "Time from a request to the last byte of its answer.",
            labels[:2],
            buckets=BUCKETS_S,
            registry=self.registry,
        )
        self.registry.register(_DatabaseCollector(read_gauges))

    def observe(self, method: str, route: str, status: int, seconds: float) -> None:
        """Count one request."""
        verb = method if method in METHODS else "other"  # anyone can invent methods, and each is a series
        self._requests.labels(verb, route, str(status)).inc()
        self._seconds.labels(verb, route).observe(seconds)

    def exposition(self) -> bytes:
        """The text that Prometheus scrapes."""
        return generate_latest(self.registry)


class _DatabaseCollector(Collector):
    def __init__(self, read_gauges: Callable[[], Gauges | None]) -> None:
        self._read = read_gauges

    def describe(self) -> list[Metric]:
        """Nothing: the registry would otherwise read the database at registration."""
        return []

    def collect(self) -> Iterator[Metric]:
        """The figures of this moment; only ``versant_database_up 0`` while there is no database."""
        gauges = self._read()
        yield GaugeMetricFamily(
            "versant_database_up", "1 while the database answers.", value=float(gauges is not None)
        )
        if gauges is None:
            return
        drives = GaugeMetricFamily("versant_drives", "Drives by status.", labels=["status"])
        for status in DRIVE_STATUSES:
            drives.add_metric([status], gauges.drives_by_status.get(status, 0))
        yield drives
        yield GaugeMetricFamily("versant_queue_depth", "Drives that wait.", value=gauges.queue_depth)
        yield GaugeMetricFamily(
            "versant_queue_oldest_wait_seconds",
            "How long the drive at the head of the queue has waited; 0 while none waits.",
            value=gauges.oldest_wait_s,
        )
        yield GaugeMetricFamily(
            "versant_data_version", "Number of the published data.", value=gauges.data_version
        )
