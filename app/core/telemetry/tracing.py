"""Traces of requests, runs and solutions for an OpenTelemetry collector; off unless ``VERSANT_OTLP_ENDPOINT`` is set.

Off, nothing that makes spans is imported and a span costs a call. The tracer is ours and not the one that libraries
find: theirs would tell whole addresses, with the boxes and places in their queries. A trace goes on from the request to
the worker: the drive's row keeps the request's ``traceparent`` (W3C Trace Context). Spans carry ids, names and counts,
as the log does, and never a place. What cannot be sent is dropped: nobody waits for the collector.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from typing import Any

from app.core.messages import say
from app.core.settings import Settings, SettingsError
from app.core.telemetry.logs import present_ids

TRACES_PATH = "/v1/traces"


class Span:
    """A stretch of work in a trace, with the field names of the log; without ``made`` (tracing is off) in none."""

    def __init__(self, made: Any = None) -> None:
        self._made = made

    def name(self, name: str) -> None:
        """Rename it."""
        if self._made is not None:
            self._made.update_name(name)

    def note(self, **facts: object) -> None:
        """Ids and counts; what is None is left out."""
        for name, value in facts.items():
            if self._made is not None and value is not None:
                plain = value if isinstance(value, bool | int | float | str) else str(value)
                self._made.set_attribute(f"versant.{name}", plain)

    def failed(self, failed: bool = True) -> None:
        """Mark it as failed, unless ``failed`` is False."""
        if self._made is not None and failed:
            from opentelemetry.trace import StatusCode  # noqa: PLC0415

            self._made.set_status(StatusCode.ERROR)


_tracer: _Tracer | None = None


def span(
    name: str, *, server: bool = False, parent: str | None = None, **facts: object
) -> AbstractContextManager[Span]:
    """A stretch of work, within the one that surrounds it or that ``parent`` (a ``traceparent``) names.

    ``server``: it answers somebody outside. An error that leaves the block marks it as failed, by its class alone.
    """
    if _tracer is None:
        return nullcontext(Span())
    return _tracer.span(name, server, parent, {**present_ids(), **facts})


def traceparent() -> str | None:
    """What names the present span to others; None: there is none."""
    return None if _tracer is None else _tracer.traceparent()


def begin_tracing(settings: Settings, process: str) -> None:
    """Send traces to ``otlp_endpoint``, where one is set; ``SettingsError`` where what that needs is not installed."""
    if settings.otlp_endpoint is None:
        return
    try:
        from opentelemetry.exporter.otlp.proto.http.trace_exporter import OTLPSpanExporter  # noqa: PLC0415
        from opentelemetry.sdk.trace.export import BatchSpanProcessor  # noqa: PLC0415
    except ImportError as error:
        raise SettingsError(say("cli.no_otel")) from error
    begin_tracing_to(BatchSpanProcessor(OTLPSpanExporter(settings.otlp_endpoint + TRACES_PATH)), process)


def begin_tracing_to(processor: Any, process: str) -> None:
    """Hand every span that ends to ``processor``, an OpenTelemetry ``SpanProcessor``."""
    global _tracer  # noqa: PLW0603 - a process has one, as it has one log
    _tracer = _Tracer(processor, process)


def end_tracing() -> None:
    """Send what waits, and make no more."""
    global _tracer  # noqa: PLW0603
    if _tracer is not None:
        _tracer.end()
        _tracer = None


class _Tracer:
    """The part of OpenTelemetry that is used; it is imported here."""

    def __init__(self, processor: Any, process: str) -> None:
        from opentelemetry.sdk.resources import Resource  # noqa: PLC0415
        from opentelemetry.sdk.trace import TracerProvider  # noqa: PLC0415
        from opentelemetry.trace.propagation.tracecontext import (  # noqa: PLC0415
            TraceContextTextMapPropagator,
        )

        about = {"service.name": "versant", "service.instance.id": process}
        self._provider = TracerProvider(resource=Resource.create(about), shutdown_on_exit=True)
        self._provider.add_span_processor(processor)
        self._tracer = self._provider.get_tracer("versant")
        self._propagator = TraceContextTextMapPropagator()

    @contextmanager
    def span(self, name: str, server: bool, parent: str | None, facts: dict[str, object]) -> Iterator[Span]:
        from opentelemetry.trace import SpanKind  # noqa: PLC0415

        context = None if parent is None else self._propagator.extract({"traceparent": parent})
        kind = SpanKind.SERVER if server else SpanKind.INTERNAL
        # Messages and tracebacks of errors may say more than the log does.
        with self._tracer.start_as_current_span(
            name, context, kind, record_exception=False, set_status_on_exception=False
        ) as made:
            reported = Span(made)
            reported.note(**facts)
            try:
                yield reported
            except BaseException as error:
                reported.note(error=type(error).__name__)
                reported.failed()
                raise

    def traceparent(self) -> str | None:
        carrier: dict[str, str] = {}
        self._propagator.inject(carrier)
        return carrier.get("traceparent")

    def end(self) -> None:
        self._provider.shutdown()
