"""Output of the commands: progress bars and notes on standard error, tables and figures on standard output."""

from __future__ import annotations

import json
import logging
import math
import os
import re
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import rich.console
import typer
from rich.progress import (
    BarColumn,
    Progress,
    SpinnerColumn,
    TaskProgressColumn,
    TextColumn,
    TimeRemainingColumn,
)
from rich.table import Table

from app.core.messages import say
from app.core.text import whole_file
from fusion.messages import message_of, speaking, told

if TYPE_CHECKING:
    from fusion.types import Progress as ProgressCall

PLAIN_WIDTH = 10_000  # columns of a table that goes into a file or a pipe: one line per row
SHORT_CELL = 40  # characters that a terminal always has room for
QUIET_S = 10.0  # without a word where lines stand for bars: short work has none, long work one every so often


@dataclass(frozen=True)
class Console:
    """One command's voice; ``quiet`` silences bars and notes, never results, warnings and errors."""

    quiet: bool = False
    debug: bool = False

    def note(self, text: str) -> None:
        """A remark for a person, on standard error."""
        if not self.quiet:
            typer.echo(spoken(text), err=True)

    def warn(self, name: str, warnings: Iterable[str]) -> None:
        """Say on standard error what a person should know of a log, or without a name of all that was given."""
        for warning in map(spoken, warnings):
            typer.echo(f"{name}: {_one_line(warning)}" if name else _one_line(warning), err=True)

    def complain(self, text: str) -> None:
        """Say on standard error what went wrong, in one line."""
        typer.echo(f"versant: {_one_line(spoken(text))}", err=True)

    def complain_of(self, path: Path | str, error: BaseException) -> str:
        """Complain of one file among several; returns the reason. The file is named once."""
        reason = sentence(error)
        named = isinstance(error, OSError) and error.filename
        self.complain(reason if named else f"{path}: {spoken(reason)}")
        return reason

    def table(
        self, columns: Sequence[str], rows: Sequence[Sequence[Any]], *, title: str | None = None
    ) -> None:
        """Print a table on standard output; numbers to the right, unknown figures as a dash."""
        table = Table(
            title=title and spoken(title), title_justify="left", box=None, pad_edge=False, header_style="bold"
        )
        for k, name in enumerate(columns):
            numeric = any(isinstance(row[k], int | float) for row in rows)
            # Figures and file names stay whole; a sentence is folded rather than cut.
            longest = max((len(figure(row[k])) for row in rows), default=0)
            table.add_column(
                spoken(name),
                justify="right" if numeric else "left",
                no_wrap=longest <= SHORT_CELL,
                overflow="fold",
            )
        for row in rows:
            table.add_row(*(figure(value) for value in row))
        out = rich.console.Console(highlight=False, markup=False)
        if not out.is_terminal:
            out = rich.console.Console(highlight=False, markup=False, width=PLAIN_WIDTH)
        out.print(table)

    @contextmanager
    def progress(self) -> Iterator[Bars]:
        """Bars on standard error while the block runs, lines where that is no terminal; nothing when quiet."""
        err = rich.console.Console(stderr=True)
        if not self.quiet and not err.is_terminal:
            yield Lines()
            return
        columns = (
            SpinnerColumn(),
            TextColumn("{task.description}", markup=False),
            BarColumn(bar_width=30),
            TaskProgressColumn(),
            TimeRemainingColumn(),
            TextColumn("{task.fields[stage]}", markup=False),
        )
        with Progress(*columns, console=err, transient=True, disable=self.quiet) as bars:
            yield Bars(bars)


class LogConsole(Console):
    """The voice of a command that runs for as long as the service: it speaks in lines of the log, as all else does."""

    def note(self, text: str) -> None:
        """A remark."""
        logging.getLogger(__name__).info(text)

    def complain(self, text: str) -> None:
        """Say what went wrong."""
        logging.getLogger(__name__).warning(_one_line(text))


class Bars:
    """Makes one bar per piece of work."""

    def __init__(self, bars: Progress) -> None:
        self._bars = bars

    def work(self, name: str) -> ProgressCall:
        """A new bar, driven by ``Progress`` calls, which count from 0 to 1 over all of the work (``part_of``)."""
        task = self._bars.add_task(spoken(name), total=1.0, stage="")
        return lambda stage, share: self._bars.update(task, completed=share, stage=spoken(stage))

    def count(self, name: str, total: int) -> Callable[[int], None]:
        """A new bar over ``total`` units; call it with how many more are done."""
        task = self._bars.add_task(spoken(name), total=max(total, 1), stage="")
        return lambda units: self._bars.update(task, advance=units)


class Lines(Bars):
    """Lines for those who read a file or a pipe: of long work, every ``QUIET_S`` seconds what is done and how far."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._said_s = clock()

    def work(self, name: str) -> ProgressCall:
        """Work that tells its stage and its share."""
        return lambda stage, share: self._say(name, share, stage)

    def count(self, name: str, total: int) -> Callable[[int], None]:
        """Work of ``total`` units; call it with how many more are done."""
        done = 0

        def more(units: int) -> None:
            nonlocal done
            done += units
            self._say(name, done / max(total, 1), "")

        return more

    def _say(self, name: str, share: float, stage: str) -> None:
        if self._clock() - self._said_s < QUIET_S:
            return
        self._said_s = self._clock()
        doing = f", {spoken(stage)}" if stage else ""
        typer.echo(f"{spoken(name)}: {min(share, 1.0):.0%}{doing}", err=True)


def part_of(progress: ProgressCall, start: float, end: float) -> ProgressCall:
    """A ``Progress`` for the part of some work from the share ``start`` of the whole to ``end``.

    The share never falls: a part of several stages, each counted from 0, waits at where the first came to.
    """
    reached = start

    def show(stage: str, share: float) -> None:
        nonlocal reached
        reached = max(reached, start + (end - start) * min(max(share, 0.0), 1.0))
        progress(stage, reached)

    return show


def figure(value: Any) -> str:
    """A table's cell: floats with two decimals, None and NaN as a dash."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return "–"
    if isinstance(value, bool):
        return spoken("yes" if value else "no")
    return (
        spoken(say("cli.figure", value=value) if isinstance(value, float) else value)
        if isinstance(value, float | str)
        else str(value)
    )


def write_json(path: Path | None, figures: Any) -> None:
    """Write what a command reports to ``--json FILE``; NaN becomes null. Without a path, nothing."""
    if path is not None:
        with whole_file(path) as partial:
            partial.write_text(json.dumps(_finite(figures), indent=2, default=str) + "\n", encoding="utf-8")


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(k): _finite(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(v) for v in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def sentence(error: BaseException) -> str:
    """One line that says what went wrong, without a traceback."""
    if type(error).__module__.split(".")[0] in {"app", "fusion"}:  # our own errors speak for themselves
        return _one_line(message_of(error))
    if isinstance(error, OSError) and error.strerror:
        where = f"{error.filename}: " if error.filename else ""
        return _one_line(say("cli.system", where=where, error=error.strerror))
    if type(error).__module__.startswith(("sqlalchemy", "psycopg")):
        cause = getattr(error, "orig", None) or error
        return _one_line(say("cli.database", reason=str(cause).strip() or type(cause).__name__))
    return _one_line(say("cli.internal", kind=type(error).__name__, error=error))


def _one_line(text: str) -> str:
    line = " ".join(text.split())
    return text if line == text else line  # one with a key keeps it


def language() -> str:
    """The language of messages in the person's locale, by the rules of POSIX; English but for German."""
    locale = next((one for name in ("LC_ALL", "LC_MESSAGES", "LANG") if (one := os.environ.get(name))), "")
    return "de" if re.match(r"de(?:_|\.|$)", locale) else "en"


def tell(key: str, **parameters: Any) -> None:
    """Say a sentence of the catalogue on standard output, in the person's language."""
    typer.echo(spoken(say(key, **parameters)))


def spoken(text: str) -> str:
    """A sentence, or a fixed word or phrase, of the program in the person's language."""
    with speaking(language()):
        return told(text)
