"""``versant drives list``, ``show`` and ``delete``: what a running service knows of drives, made to be read."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from datetime import datetime
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import typer

from app.cli.console import Console, figure, spoken, write_json
from app.cli.options import JSON_FILE, arg, opt
from app.cli.remote import KEY, KEY_DIR, SERVER, service_client
from app.cli.uploads.rows import shown_status
from app.core.messages import say
from fusion.messages import message_of, remarks_of, with_key

if TYPE_CHECKING:
    from app.cli.client import Client

PAGE_DRIVES = 1000
SHORT_REASON = 80
"""Characters of a reason in a list; ``show`` gives all of it."""
SHOWN_FAILURES = 100
"""Drives that failed in a batch and are named at its end."""

drives = typer.Typer(
    no_args_is_help=True, help="List, show, delete or process again the drives of a service."
)
DRIVE_IDS = arg("Drives, as `list` names them.", metavar="ID...")


def a_moment(text: str | None) -> str | None:
    """Callback of an option that names a time; raises ``typer.BadParameter``."""
    try:
        if text is not None:
            datetime.fromisoformat(text)
        return text
    except ValueError:
        raise typer.BadParameter(spoken(say("drives.no_time", text=text))) from None


Status = Literal["queued", "running", "done", "failed", "cancelled"]
"""Where a drive stands; the service's own names, known here without loading it."""


@drives.command("list")
def list_drives(
    ctx: typer.Context,
    server: str | None = SERVER,
    key: str | None = KEY,
    data_dir: Path | None = KEY_DIR,
    status: Status | None = opt("Only drives of this status."),
    failure: str | None = opt(
        "Only drives that failed so, such as no-match or malformed-log.", metavar="KIND"
    ),
    waits_for: Literal["roads"] | None = opt("Only drives that wait for that.", "--waits-for"),
    since: str | None = opt(
        "Only drives uploaded since, such as 2026-11-20.", metavar="TIME", callback=a_moment
    ),
    batch: int | None = opt("Only drives that were last asked for with this batch.", min=1),
    limit: int = opt("At most so many.", default=100, min=1),
    json_file: Path | None = JSON_FILE,
) -> None:
    """List drives, the newest upload first, with the reason of what failed."""
    console: Console = ctx.obj
    filters: dict[str, str | int | None] = {"status": status, "failure": failure, "waits_for": waits_for}
    filters |= {"created_after": since, "batch": batch}
    with service_client(server, key, data_dir) as client:
        drives = listed(client, filters, limit)
    columns = ("id", "status", "file", "km", "segments", "uploaded", "method", "reason")
    console.table(columns, [_row(one) for one in drives])
    if len(drives) == limit:
        console.note(say("drives.newest", n=limit))
    write_json(json_file, {"server": client.server, "drives": drives})


@drives.command("show")
def show(
    ctx: typer.Context,
    drive: str = arg("A drive, as `list` names it.", metavar="ID"),
    server: str | None = SERVER,
    key: str | None = KEY,
    data_dir: Path | None = KEY_DIR,
    json_file: Path | None = JSON_FILE,
) -> None:
    """Show what is known of a drive: file, times, result, climbs, warnings; all of its report with --json."""
    with service_client(server, key, data_dir) as client:
        document = client.drive(drive).document
        document["ride"] = _ride(client, document)
    typer.echo("\n".join(drive_lines(document)))
    write_json(json_file, document)


@drives.command("delete")
def delete(
    ctx: typer.Context,
    ids: list[str] = DRIVE_IDS,
    server: str | None = SERVER,
    key: str | None = KEY,
    data_dir: Path | None = KEY_DIR,
) -> None:
    """Delete drives: their logs, and their influence on every segment; exit status 1 if any cannot be deleted."""
    from app.cli.client import ClientError, RefusedKeyError

    console: Console = ctx.obj
    failed = False
    with service_client(server, key, data_dir) as client:
        client.get("/healthz")  # a service that is not there is said once, not per drive
        for one in ids:
            try:
                client.request("DELETE", f"/v1/drives/{one}")
            except RefusedKeyError:
                raise  # said once, not per drive
            except ClientError as error:
                failed = True
                console.complain(message_of(error))
    if failed:
        raise typer.Exit(1)


def listed(client: Client, filters: Mapping[str, Any], limit: int) -> list[dict[str, Any]]:
    """The newest drives for which that holds, page after page; what is None is not asked."""
    query = {"limit": min(limit, PAGE_DRIVES)} | {k: v for k, v in filters.items() if v is not None}
    drives = (one for page in client.pages("/v1/drives", query) for one in page["drives"])
    return list(islice(drives, limit))


def failures_table(console: Console, failed: Iterable[Mapping[str, Any]]) -> None:
    """Which drives failed and why, in full."""
    rows = [
        [one["id"], one["filename"], _failure(one).get("kind"), _spoken(_failure(one), "reason", "said")]
        for one in failed
    ]
    console.table(["id", "file", "kind", "reason"], rows)


def drive_lines(document: Mapping[str, Any]) -> list[str]:
    """A drive's document as lines to read, in groups; what is unknown is left out."""
    failure, report, waits_for = _failure(document), document.get("report") or {}, document.get("waits_for")
    result = "Result" if not failure else "Result of an earlier run" if report else "What the log says"
    groups = {
        say("drives.title", id=document["id"]): _of_drive(document),
        "Times": {
            name: _when(document.get(f"{name}_at")) for name in ("created", "queued", "started", "finished")
        }
        | {"recorded": _when(document.get("drive_time"))},
        "Reason" if waits_for else "Failure": {
            "kind": failure.get("kind"),
            "stage": spoken(failure.get("stage") or ""),
            "where": _spoken(failure, "where", "where_said"),
            "reason": _spoken(failure, "reason", "said"),
        },
        result: _of_result(document, report),
        "Ride": _of_ride(document.get("ride") or {}),
    }
    lines: list[str] = []
    for title, facts in groups.items():
        present = {spoken(name): value for name, value in facts.items() if value not in (None, "", [], {})}
        if present:
            width = max(map(len, present))
            lines += [*([""] if lines else []), spoken(title)]
            lines += [f"  {name:<{width}}  {figure(value)}" for name, value in present.items()]
    if warnings := remarks_of(report):
        lines += ["", spoken("Warnings"), *(f"  {spoken(sentence)}" for sentence in warnings)]
    return lines


def _of_drive(document: Mapping[str, Any]) -> dict[str, Any]:
    under_way, waits_for = document["status"] in {"queued", "running"}, document.get("waits_for")
    options = ", ".join(f"{name}={value}" for name, value in (document.get("options") or {}).items())
    return {
        "file": document["filename"],
        "size": _size(document.get("size_bytes")),
        "status": shown_status(document["status"], waits_for),
        "extract that would help": (waits_for or {}).get("extract"),
        "stage": document.get("stage") if under_way else None,
        "progress": _percent(document.get("progress")) if under_way else None,
        "method": document["method"],
        "options": options,
        "duplicate of": document.get("duplicate_of"),
        "cells not solved": ", ".join(document.get("unsolved") or ()),
    }


def _of_result(document: Mapping[str, Any], report: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "length": _formed("{:.2f} km", _km(document)),
        "segments": report.get("segments_estimated"),
        "median sigma": _formed("{:.2g} %", report.get("median_slope_sigma_percent")),
        "positions": document.get("epochs"),
        "matched to roads": _percent(report.get("matched_share")),
        "rejected segments": report.get("rejected_segments"),
        "west,south,east,north": ",".join(f"{degrees:.5f}" for degrees in document.get("bbox") or ()),
        "code version": report.get("code_version"),
        "roads version": report.get("road_version"),
        "elevation version": report.get("dem_version"),
    }


def _ride(client: Client, document: Mapping[str, Any]) -> dict[str, Any] | None:
    """The figures of its ride; None without a result, and for a key that may not read it."""
    from app.cli.client import ClientError

    if document.get("report") is None:
        return None
    try:
        profile = client.request("GET", f"/v1/drives/{document['id']}/profile", params={"points": 2}).json()
    except ClientError:
        return None
    return dict(profile.get("ride") or {}) or None


def _of_ride(ride: Mapping[str, Any]) -> dict[str, Any]:
    steep = ride.get("steepest") or {}
    climbs: dict[str, str] = {
        say("drives.climb_number", n=n): _climb(one) for n, one in enumerate(ride.get("climbs") or (), 1)
    }
    return {
        "ascent": _with_sigma(ride.get("ascent_m"), ride.get("ascent_sigma_m"), "m", 0),
        "descent": _with_sigma(ride.get("descent_m"), ride.get("descent_sigma_m"), "m", 0),
        "steepest 100 m": steep
        and say("drives.steepest", grade=_grade(steep), km=steep["from_m"] / 1000, on=_on(steep)),
        **climbs,
    }


def _climb(one: Mapping[str, Any]) -> str:
    category = say("drives.category", category=one["category"]) if one["category"] else ""
    return say(
        "drives.climb",
        from_km=one["from_m"] / 1000,
        to_km=one["to_m"] / 1000,
        on=_on(one),
        gain_m=one["gain_m"],
        grade=_grade(one),
        most=one["maximum_percent"],
        category=category,
    )


def _grade(one: Mapping[str, Any]) -> str | None:
    return _with_sigma(one["percent"], one["sigma_percent"], "%", 1)


def _on(one: Mapping[str, Any]) -> str:
    return f" ({one['name']})" if one["name"] else ""


def _with_sigma(value: float | None, sigma: float | None, unit: str, digits: int) -> str | None:
    if value is None:
        return None
    doubt = "" if sigma is None else f" ± {sigma:.{digits}f}"
    return f"{value:.{digits}f}{doubt} {unit}"


def _row(document: Mapping[str, Any]) -> list[Any]:
    reason = _spoken(_failure(document), "reason", "said")
    short = reason if len(reason) <= SHORT_REASON else reason[:SHORT_REASON].rpartition(" ")[0] + " ..."
    return [
        document["id"],
        shown_status(document["status"], document.get("waits_for")),
        document["filename"],
        _km(document),
        (document.get("report") or {}).get("segments_estimated"),
        _when(document.get("created_at")),
        document["method"],
        short,
    ]


def _failure(document: Mapping[str, Any]) -> Mapping[str, Any]:
    return document.get("failure") or {}


def _spoken(failure: Mapping[str, Any], name: str, key: str) -> str:
    return spoken(with_key(failure.get(name) or "", failure.get(key)))


def _km(document: Mapping[str, Any]) -> float | None:
    metres = document.get("distance_m")
    return None if metres is None else float(metres) / 1000


def _when(moment: str | None) -> str | None:
    """To the second; UTC."""
    return None if moment is None else moment[:19].replace("T", " ") + "Z"


def _percent(share: float | None) -> str | None:
    return None if share is None else f"{100 * share:.0f} %"


def _formed(form: str, number: float | None) -> str | None:
    return None if number is None else form.format(number)


def _size(count: int | None) -> str | None:
    if count is None:
        return None
    return f"{count} bytes" if count < 10_000 else f"{count / 1e6:.2f} MB"
