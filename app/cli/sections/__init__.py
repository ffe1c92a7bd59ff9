"""``versant hpms``: how much of each section of a road authority's list lies in which class of grade."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import typer

import app.cli.options as cli
from app.cli.console import Console, tell, write_json
from app.cli.database import sessions as databases
from app.core.messages import say
from app.core.text import whole_file

MOST_OFF = 0.05
"""A line that is longer or shorter than its section by a larger share of it is told of."""

app = typer.Typer(add_completion=False)


@app.command("hpms")
def hpms(
    ctx: typer.Context,
    sections: Path = cli.arg(
        "Sections with route_id, begin_point, end_point (miles) and their lines, longitude and latitude: .geojson, "
        "or .csv with a column wkt.",
        metavar="SECTIONS",
    ),
    out: Path = cli.written_file("-o", "--out", help="Table of the sections: .csv.", default=...),
    radius_m: float = cli.opt(
        "How far off its road a line may lie, metres.", "--radius-m", default=25.0, min=1.0, max=100.0
    ),
    data_dir: Path | None = cli.DATA_DIR,
    json_file: Path | None = cli.JSON_FILE,
) -> None:
    """Write how many miles of each section lie in the grade classes A to F of HPMS.

    Lines are followed along the roads, and only what drives measured counts; the rest of a section is a column of its
    own. Lengths are scaled to the section's, end_point less begin_point.
    """
    from app.cli.sections.reading import DIGITS, METRES_PER_MILE, read_sections, row_of
    from app.core.db import snapshot
    from app.map.heights.classes import by_class
    from app.map.segment import attribution

    console: Console = ctx.obj
    listed = read_sections(sections)
    rows = []
    with databases(data_dir) as (_, factory), snapshot(factory) as session, console.progress() as bars:
        more = bars.count(sections.name, len(listed))
        for one in listed:
            found = by_class(session, one.line_deg, radius_m)
            line_miles = found.whole_m / METRES_PER_MILE
            if abs(line_miles - one.miles) > MOST_OFF * one.miles:
                text = say("hpms.other_length", section=one.name, line=line_miles, miles=one.miles)
                console.warn(sections.name, [text])
            rows.append(row_of(one, found))
            more(1)
    with whole_file(out) as partial, partial.open("w", encoding="utf-8", newline="") as file:
        table = csv.DictWriter(file, rows[0])
        table.writeheader()
        table.writerows(rows)
    whole, unmeasured = (sum(row[name] for row in rows) for name in ("section_miles", "unmeasured_miles"))
    share = 1 - unmeasured / whole if whole else 0.0
    tell("hpms.written", file=out, n=len(rows), miles=whole, share=share)
    figures: dict[str, Any] = {"file": str(out), "sections": len(rows), "miles": round(whole, DIGITS)}
    figures |= {"measured_share": round(share, DIGITS), "attribution": attribution()}
    console.note(figures["attribution"])
    write_json(json_file, figures)
