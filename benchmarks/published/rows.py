"""One published figure beside ours: the row that every part of ``seeds.py`` yields, and its tables."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from accuracy.scoring import aligned

_HEADER = ("quantity", "unit", "published", "ours: median", "least", "most", "seeds")
_TEXT_COLUMNS = {"", "quantity", "unit", "published", "ours"}
"""Columns that stand to the left; figures stand to the right."""

_PUBLISHED = "published"
Table = list[tuple[str, ...]]


@dataclass(frozen=True)
class Row:
    """A quantity of an experiment: what the document prints, as it stands there, and what we got, one value per seed.

    NaN stands for a seed without a value. ``note`` is a sentence on the difference between the two. Where an experiment
    compares several subjects, each quantity is named "subject: quantity", and its table has a line a subject.
    """

    experiment: str
    quantity: str
    unit: str
    published: str
    ours: list[float]
    note: str = ""


def median(values: Sequence[float]) -> float:
    """The median of ascending values, NaN without any."""
    middle = len(values) // 2
    if not values:
        return math.nan
    return values[middle] if len(values) % 2 else (values[middle - 1] + values[middle]) / 2


def number(value: float) -> str:
    """Three significant digits without an exponent where that can be read; a dash for NaN."""
    if not math.isfinite(value):
        return "-"
    if value == 0:
        return "0"
    digits = 2 - math.floor(math.log10(abs(value)))
    return f"{value:.1e}" if abs(value) < 1e-4 else f"{value:.{max(0, digits)}f}"


def by_experiment(rows: Sequence[Row]) -> dict[str, list[Row]]:
    """The rows under their experiments, both in the order in which they came."""
    groups: dict[str, list[Row]] = {}
    for row in rows:
        groups.setdefault(row.experiment, []).append(row)
    return groups


def text_table(rows: Sequence[Row]) -> str:
    """Tables for a terminal, one per experiment, with the notes below."""
    blocks = []
    for name, group in by_experiment(rows).items():
        table = _table(group)
        lines = aligned(table, [name in _TEXT_COLUMNS for name in table[0]])
        blocks.append("\n".join([name, *lines, *_notes(group)]))
    return "\n\n".join(blocks)


def markdown_table(rows: Sequence[Row]) -> str:
    """One experiment's rows as a Markdown table, with the notes as a list below: a line a row, or a subject."""
    if all(": " in row.quantity for row in rows):
        return _markdown(_by_subject(rows), _notes(rows))
    lines = [(row.quantity, row.unit, row.published or "-", spread(row)) for row in rows]
    return _markdown([("quantity", "unit", "published", "ours"), *lines], _notes(rows))


def side_by_side(rows: Sequence[Row]) -> str:
    """Several experiments as one Markdown table: a line a quantity, a column an experiment, in italics what is printed.

    The notes stand below as a list.
    """
    columns = list(by_experiment(rows))
    cells = {
        (row.quantity, row.experiment): f"{spread(row)} *{row.published}*".removesuffix(" **").removesuffix(
            " *-*"
        )
        for row in rows
    }
    units = {row.quantity: row.unit for row in rows}
    lines = [
        (f"{quantity}, {unit}" if unit else quantity, *(cells.get((quantity, name), "-") for name in columns))
        for quantity, unit in units.items()
    ]
    notes_of: dict[str, set[str]] = {}
    for row in rows:
        notes_of.setdefault(row.quantity, set()).update([row.note] if row.note else [])
    named = [
        replace(row, quantity=f"{row.quantity} ({row.experiment})")
        if len(notes_of[row.quantity]) > 1
        else row
        for row in rows
    ]
    return _markdown([("quantity", *columns), *lines], _notes(named))


def _markdown(table: Table, notes: Sequence[str]) -> str:
    head, *body = table
    rule = ["---" if name in _TEXT_COLUMNS else "---:" for name in head]
    lines = [
        "| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in (head, rule, *body)
    ]
    return "\n".join([*lines, "", *notes] if notes else lines)


def _table(rows: Sequence[Row]) -> Table:
    """Header and lines: a line a row, or a line a subject where every row names one."""
    if all(": " in row.quantity for row in rows):
        return _by_subject(rows)
    return [_HEADER, *(_cells(row) for row in rows)]


def _cells(row: Row) -> tuple[str, ...]:
    values = _finite(row)
    ends = (values[0], values[-1]) if values else (math.nan, math.nan)
    figures = (number(value) for value in (median(values), *ends))
    return row.quantity, row.unit, row.published or "-", *figures, str(len(values))


def _by_subject(rows: Sequence[Row]) -> Table:
    """A line a subject, a column a quantity; first what is printed, where anything is."""
    tables: dict[str, dict[str, str]] = {_PUBLISHED: {}}
    for row in rows:
        subject, _, quantity = row.quantity.partition(": ")
        title = f"{quantity}, {row.unit}" if row.unit else quantity
        tables.setdefault(subject, {})[title] = spread(row)
        if row.published:
            tables[_PUBLISHED][title] = row.published
    if not tables[_PUBLISHED]:
        del tables[_PUBLISHED]
    columns = tuple(
        dict.fromkeys(title for subject in tables if subject != _PUBLISHED for title in tables[subject])
    )
    lines = [(subject, *(line.get(title, "-") for title in columns)) for subject, line in tables.items()]
    return [("", *columns), *lines]


def spread(row: Row) -> str:
    """The median and, where seeds differ, least and most; a dash without a value."""
    values = _finite(row)
    if not values:
        return "-"
    least, most = number(values[0]), number(values[-1])
    return number(median(values)) + ("" if least == most else f" ({least} to {most})")


def _finite(row: Row) -> list[float]:
    """The finite values, ascending."""
    return sorted(value for value in row.ours if math.isfinite(value))


def _notes(rows: Sequence[Row]) -> list[str]:
    """Each sentence once, with the quantities it is about."""
    about: dict[str, list[str]] = {}
    for row in rows:
        if row.note:
            about.setdefault(row.note, []).append(row.quantity)
    return [f"- {'; '.join(dict.fromkeys(names))}: {note}" for note, names in about.items()]
