"""``versant drives``: drives of a running service listed, shown, deleted, processed again; a client of its API."""

# ruff: noqa: PLC0415 - a command imports what it needs when it runs (see app.cli)

from __future__ import annotations

import json
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any

import typer

from app.cli.console import Console, write_json
from app.cli.options import GnssOption, JsonFile, parse_assignments
from app.cli.remote import GnssChoice, Server, service_client

if TYPE_CHECKING:
    from app.cli.client import Client
    from fusion.types import Progress

POLL_S = 2.0
PAGE_DRIVES = 1000
_ADDRESS = "/v1/drives/reprocess"

drives = typer.Typer(no_args_is_help=True)
app = typer.Typer(add_completion=False)
app.add_typer(drives, name="drives")

DriveIds = Annotated[list[str], typer.Argument(metavar="ID...", help="Drives, as `list` names them.")]
Moment = Annotated[
    str | None, typer.Option(metavar="TIME", help="Such as 2026-11-20 or 2026-11-20T09:00:00Z.")
]


@drives.callback()
def explain() -> None:
    """List, show, delete or process again the drives of a service."""


@drives.command("list")
def list_drives(
    ctx: typer.Context,
    server: Server = None,
    status: Annotated[
        str | None, typer.Option(help="queued, running, done, failed or cancelled; without it all.")
    ] = None,
    limit: Annotated[int, typer.Option(min=1, help="At most so many.")] = 100,
    json_file: JsonFile = None,
) -> None:
    """List drives, the newest upload first."""
    console: Console = ctx.obj
    with service_client(server) as client:
        found = _listed(client, status, limit)
    columns = ("id", "status", "method", "filename", "created_at")
    rows = [[*(one[name] for name in columns), (one["failure"] or {}).get("reason")] for one in found]
    console.table([*columns, "reason"], rows)
    write_json(json_file, {"server": client.server, "drives": found})


@drives.command("show")
def show(
    ctx: typer.Context,
    drive: Annotated[str, typer.Argument(metavar="ID", help="A drive, as `list` names it.")],
    server: Server = None,
    json_file: JsonFile = None,
) -> None:
    """Show what is known of a drive; its report with --json."""
    console: Console = ctx.obj
    with service_client(server) as client:
        document = client.drive(drive).document
    told = {name: value for name, value in document.items() if name not in {"report", "links", "failure"}}
    told |= document.get("failure") or {}
    console.table(
        ["what", "value"], [[name, None if value is None else str(value)] for name, value in told.items()]
    )
    for warning in (document.get("report") or {}).get("warnings", ()):
        typer.echo(warning)
    write_json(json_file, document)


@drives.command("delete")
def delete(ctx: typer.Context, ids: DriveIds, server: Server = None) -> None:
    """Delete drives: their logs, and their influence on every segment; exit status 1 if any cannot be deleted."""
    from app.cli.client import ClientError

    console: Console = ctx.obj
    failed = False
    with service_client(server) as client:
        client.get("/healthz")  # a service that is not there is said once, not per drive
        for one in ids:
            try:
                client.request("DELETE", f"/v1/drives/{one}")
            except ClientError as error:
                failed = True
                console.complain(str(error))
    if failed:
        raise typer.Exit(1)


@drives.command("reprocess")
def reprocess(
    ctx: typer.Context,
    every: Annotated[bool, typer.Option("--all", help="Every drive that is done or failed.")] = False,
    stale: Annotated[
        bool,
        typer.Option("--stale", help="Drives that another version of the code, or other defaults, computed."),
    ] = False,
    failed: Annotated[bool, typer.Option("--failed", help="Drives that failed.")] = False,
    region: Annotated[
        str | None, typer.Option(metavar="NAME", help="Only drives on roads of this region.")
    ] = None,
    drive: Annotated[
        list[str] | None, typer.Option(metavar="ID", help="This drive; may be given several times.")
    ] = None,
    bbox: Annotated[
        str | None, typer.Option(metavar="WEST,SOUTH,EAST,NORTH", help="Only drives there; degrees.")
    ] = None,
    from_method: Annotated[
        str | None, typer.Option(metavar="NAME", help="Only drives of this method.")
    ] = None,
    code_version: Annotated[
        str | None, typer.Option(metavar="VERSION", help="Only drives that this version computed.")
    ] = None,
    failure: Annotated[str | None, typer.Option(metavar="KIND", help="Only drives that failed so.")] = None,
    created_after: Moment = None,
    created_before: Moment = None,
    driven_after: Moment = None,
    driven_before: Moment = None,
    method: Annotated[
        str | None,
        typer.Option(
            help="Estimator; without it each keeps its own, or the service's default is taken (see above)."
        ),
    ] = None,
    gnss: GnssChoice = None,
    gnss_option: GnssOption = None,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Only count the drives.")] = False,
    wait: Annotated[bool, typer.Option("--wait", help="Wait until each drive is done or failed.")] = False,
    cancel: Annotated[
        int | None,
        typer.Option(metavar="BATCH", help="Take what waits of that batch out of the queue instead."),
    ] = None,
    server: Server = None,
    json_file: JsonFile = None,
) -> None:
    """Let a service process drives again, behind uploads; exit status 1 if any failed that was waited for.

    Without --all, --stale, --failed or --drive: those that are not of the method already, which is the service's
    default unless --method names one. What a drive published stays until its new run replaces it.
    """
    which = {"all": every, "stale": stale, "failed": failed or (failure is not None and not (every or stale))}
    filters = {
        "bbox": bbox, "from_method": from_method, "code_version": code_version, "failure": failure,
        "created_after": created_after, "created_before": created_before, "driven_after": driven_after,
        "driven_before": driven_before, "region": region,
    }  # fmt: skip
    asked = [("which", name) for name, chosen in which.items() if chosen]
    narrowed = {name: value for name, value in filters.items() if value is not None}
    _check_choice(len(asked), bool(narrowed) or dry_run, bool(drive) + (cancel is not None))
    positioning = _positioning(gnss, gnss_option or [], named=bool(drive))
    console: Console = ctx.obj
    with service_client(server) as client, console.progress() as bars:
        if drive:
            batch = _each(client, drive, positioning | ({} if method is None else {"method": method}), wait)
        elif cancel is not None:
            batch = Batch.read(
                client.request("DELETE", _ADDRESS, params={"batch": cancel}).json(), str(cancel)
            )
            typer.echo(
                f"Batch {cancel}: {batch.running} drive(s) still run, {batch.done} done, {batch.failed} failed."
            )
        else:
            batch = _ask(client, dict(asked) | narrowed, method, dry_run)
            if wait and batch.number:
                batch = _follow(client, batch, bars.work("reprocessing"))
    if wait and not dry_run:
        typer.echo(f"{batch.done} done, {batch.failed} failed.")
    write_json(json_file, {"server": client.server, **vars(batch)})
    if wait and batch.failed:
        raise typer.Exit(1)


@dataclass(frozen=True)
class Batch:
    """Drives that are processed again, as the service describes them; ``number`` None: no batch of it."""

    number: str | None
    drives: int
    running: int = 0
    done: int = 0
    failed: int = 0

    @classmethod
    def read(cls, document: dict[str, Any], number: str) -> Batch:
        """Build from the batch's JSON document."""
        return cls(number, *(int(document[name]) for name in ("drives", "running", "done", "failed")))


def _check_choice(kinds: int, narrowed: bool, named: int) -> None:
    """``typer.BadParameter`` for what contradicts itself: drives and batches that are named need no filter."""
    if kinds + named > 1 or (named and narrowed):
        raise typer.BadParameter(
            "Choose one of --all, --stale, --failed, --drive and --cancel; --dry-run and filters go with the first "
            "three, or with none."
        )


def _listed(client: Client, status: str | None, limit: int) -> list[dict[str, Any]]:
    """The newest drives, page after page."""
    asked = {"limit": min(limit, PAGE_DRIVES)} | ({} if status is None else {"status": status})
    page = client.request("GET", "/v1/drives", params=asked).json()
    found: list[dict[str, Any]] = page["drives"]
    while len(found) < limit:
        following = [link["href"] for link in page["links"] if link["rel"] == "next"]
        if not following:
            break
        page = client.get(following[0]).json()
        found += page["drives"]
    return found[:limit]


def _ask(client: Client, asked: dict[str, str], method: str | None, dry_run: bool) -> Batch:
    more = {"method": method, "dry_run": "true" if dry_run else None}
    params = asked | {name: value for name, value in more.items() if value is not None}
    answer = client.request("POST", _ADDRESS, params=params)
    document = answer.json()
    if dry_run:
        typer.echo(f"{document['queued']} drive(s) would be processed again.")
        return Batch(None, int(document["queued"]))
    number = answer.headers["Location"].rpartition("=")[2]
    rest = "" if document["complete"] else " so far; a worker puts the rest into the queue"
    typer.echo(f"{document['queued']} drive(s) are processed again{rest}. Batch {number}.")
    return Batch(number, int(document["queued"]))


def _follow(client: Client, batch: Batch, show: Progress) -> Batch:
    """Look at the batch until nothing of it is left to do."""
    while True:
        document = client.request("GET", _ADDRESS, params={"batch": batch.number}).json()
        batch = Batch.read(document, str(batch.number))
        show(f"{batch.done + batch.failed} of {batch.drives}", document["progress"])
        if document["state"] in {"done", "cancelled"} and not batch.running:
            return batch
        time.sleep(POLL_S)


def _positioning(gnss: str | None, gnss_option: list[str], *, named: bool) -> dict[str, Any]:
    """The query for another positioning; ``typer.BadParameter`` unless drives are named, since a batch knows none."""
    options = parse_assignments(gnss_option)
    if not named and (gnss or options):
        raise typer.BadParameter("--gnss and --gnss-option go with --drive.", param_hint="'--gnss'")
    asked: dict[str, Any] = {"gnss": gnss} if gnss else {}
    if options:
        asked["gnss_option"] = [f"{name}:{json.dumps(value)}" for name, value in options.items()]
    return asked


def _each(client: Client, ids: list[str], asked: dict[str, Any], wait: bool) -> Batch:
    """Ask for drives one by one."""
    for one in ids:
        client.request("POST", f"/v1/drives/{one}/reprocess", params=asked)
    typer.echo(f"{len(ids)} drive(s) are processed again.")
    ended = [client.wait(one).status for one in ids] if wait else []
    return Batch(None, len(ids), done=ended.count("done"), failed=len(ended) - ended.count("done"))
