"""Traces: off unless they are asked for, and what is said where they cannot be made. Those of drives: ``test_told``."""

from __future__ import annotations

import subprocess
import sys
from typing import Any

import pytest

from app.core.settings import Settings, SettingsError
from app.core.telemetry import tracing

OFF = """
import sys
from app.core.settings import Settings
from app.core.telemetry import tracing
from app.main import create_app
settings = Settings(database_url="postgresql://nobody@localhost/none")
create_app(settings)
tracing.begin_tracing(settings, "api")
with tracing.span("work", parent="00-0af7651916cd43dd8448eb211c80319c-b7ad6b7169203331-01") as span:
    span.name("other")
    span.note(drives=1)
    span.failed()
    assert tracing.traceparent() is None
tracing.end_tracing()
print(*sorted(name for name in sys.modules if name.startswith(("opentelemetry.sdk", "opentelemetry.exporter"))))
"""


def test_without_an_address_nothing_that_makes_spans_is_loaded() -> None:
    """FastAPI itself loads the interface where that is installed."""
    done = subprocess.run([sys.executable, "-c", OFF], capture_output=True, text=True, check=True)
    assert done.stdout.split() == []


def test_an_address_without_the_packages_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "opentelemetry.exporter.otlp.proto.http.trace_exporter", None)
    with pytest.raises(SettingsError, match=r"pip install 'versant\[otel\]'"):
        tracing.begin_tracing(Settings(otlp_endpoint="http://127.0.0.1:9"), "api")


def test_spans_go_to_the_collector_that_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    handed: list[tuple[Any, str]] = []
    monkeypatch.setattr(
        tracing, "begin_tracing_to", lambda processor, process: handed.append((processor, process))
    )
    tracing.begin_tracing(Settings(otlp_endpoint="http://127.0.0.1:9/"), "worker 2")
    ((processor, process),) = handed
    assert process == "worker 2"
    assert processor.span_exporter._endpoint == "http://127.0.0.1:9/v1/traces"
    processor.shutdown()
