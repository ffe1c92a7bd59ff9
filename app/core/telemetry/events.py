"""Stretches of work that are logged, timed and traced at once: stages of a drive, and imports."""

from __future__ import annotations

import dataclasses
import functools
import logging
import time
from collections.abc import Callable
from contextlib import ExitStack
from typing import ParamSpec, TypeVar

from app.core.telemetry import tracing
from app.core.telemetry.logs import tell
from app.core.telemetry.measures import IMPORT_S, IMPORTS, STAGE_S
from fusion.errors import FusionError

logger = logging.getLogger(__name__)

P = ParamSpec("P")
R = TypeVar("R")


class Stages:
    """The stages of a drive's run, one after the other; the same one may come again."""

    def __init__(self, method: str) -> None:
        self._method = method
        self._open = ExitStack()
        self._stage: str | None = None
        self._began_s = 0.0
        self._seconds: dict[str, float] = {}

    def begin(self, stage: str) -> None:
        """End the former stage and begin this one."""
        self.end()
        self._open.enter_context(tracing.span(f"drive {stage}", stage=stage))
        self._stage, self._began_s = stage, time.monotonic()

    def end(self, error: BaseException | None = None) -> None:
        """End the present stage; ``error`` is what ended it."""
        if self._stage is not None:
            took_s = time.monotonic() - self._began_s
            self._seconds[self._stage] = self._seconds.get(self._stage, 0.0) + took_s
            STAGE_S.observe(took_s, self._stage, self._method)
            self._stage = None
            opened = self._open.pop_all()
            if error is None:
                opened.close()
            else:
                opened.__exit__(type(error), error, error.__traceback__)

    @property
    def seconds(self) -> dict[str, float]:
        """Seconds of each stage, as fields of a line of the log."""
        return {f"{stage}_s": took_s for stage, took_s in self._seconds.items()}


def imported(kind: str) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Decorator of a function that imports something: logs, counts and traces its counts, duration and failure."""

    def wrap(function: Callable[P, R]) -> Callable[P, R]:
        @functools.wraps(function)
        def wrapped(*arguments: P.args, **options: P.kwargs) -> R:
            started_s = time.monotonic()
            with tracing.span(f"import {kind}") as span:
                try:
                    result = function(*arguments, **options)
                except BaseException as error:
                    IMPORTS.count(kind, "failed")
                    reason = str(error) if isinstance(error, FusionError) else type(error).__name__
                    tell(logger, f"import of {kind} failed", reason=reason)
                    raise
                if getattr(result, "dry_run", False):  # it only said what it would do
                    return result
                took_s = time.monotonic() - started_s
                IMPORTS.count(kind, "done")
                IMPORT_S.observe(took_s, kind)
                counts = _counts(result)
                span.note(**counts)
                tell(logger, f"{kind} imported", seconds=took_s, **counts)
                return result

        return wrapped

    return wrap


def _counts(result: object) -> dict[str, int]:
    """The figures of what an import returns."""
    if not dataclasses.is_dataclass(result):
        return {}
    fields = ((one.name, getattr(result, one.name)) for one in dataclasses.fields(result))
    return {name: value for name, value in fields if isinstance(value, int) and not isinstance(value, bool)}
