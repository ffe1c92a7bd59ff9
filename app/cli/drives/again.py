"""``versant drives reprocess``: drives of a running service processed again, many at once or one by one."""

from __future__ import annotations

import json
import time
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from app.cli.console import Console, spoken, tell, write_json
from app.cli.drives.look import SHOWN_FAILURES, drives, failures_table, listed
from app.cli.options import GNSS_OPTION, JSON_FILE, flag, opt, parse_assignments
from app.cli.remote import GNSS_CHOICE, KEY, KEY_DIR, SERVER, service_client
from app.core.messages import say
from fusion.messages import with_key

if TYPE_CHECKING:
    from app.cli.client import Client
    from fusion.types import Progress

POLL_S = 2.0
_ADDRESS = "/v1/drives/reprocess"

app = typer.Typer(add_completion=False)
app.add_typer(drives, name="drives")

MOMENT = opt("Such as 2026-11-20 or 2026-11-20T09:00:00Z.", metavar="TIME")


@drives.command("reprocess")
def reprocess(
    ctx: typer.Context,
    every: bool = flag("Every drive that is done or failed.", "--all"),
    stale: bool = flag(
        "Drives that another version of the code, other defaults, or other elevation rasters where "
        "they drove, computed, or on other roads than stand there now.",
        "--stale",
    ),
    failed: bool = flag("Drives that failed.", "--failed"),
    region: str | None = opt("Only drives on roads of this region.", metavar="NAME"),
    drive: list[str] | None = opt("This drive; may be given several times.", metavar="ID"),
    bbox: str | None = opt("Only drives there; degrees.", metavar="WEST,SOUTH,EAST,NORTH"),
    from_method: str | None = opt("Only drives of this method.", metavar="NAME"),
    code_version: str | None = opt("Only drives that this version computed.", metavar="VERSION"),
    failure: str | None = opt("Only drives that failed so.", metavar="KIND"),
    created_after: str | None = MOMENT,
    created_before: str | None = MOMENT,
    driven_after: str | None = MOMENT,
    driven_before: str | None = MOMENT,
    method: str | None = opt(
        "Estimator; without it each keeps its own, or the service's default is taken (see above)."
    ),
    gnss: str | None = GNSS_CHOICE,
    gnss_option: list[str] | None = GNSS_OPTION,
    force: bool = flag("Also drives whose log itself this version found to be unusable.", "--force"),
    dry_run: bool = flag("Only count the drives.", "--dry-run"),
    wait: bool = flag("Wait until each drive is done or failed.", "--wait"),
    cancel: int | None = opt("Take what waits of that batch out of the queue instead.", metavar="BATCH"),
    server: str | None = SERVER,
    key: str | None = KEY,
    data_dir: Path | None = KEY_DIR,
    json_file: Path | None = JSON_FILE,
) -> None:
    """Let a service process drives again, behind uploads; exit status 1 if any failed that was waited for.

    Without --all, --stale, --failed or --drive: those that are not of the method already, which is the service's
    default unless --method names one. What a drive published stays until its new run replaces it.

    Failed drives whose log itself cannot be used are left out, as long as the version of the code is the same, unless
    --drive, --failure or --force asks for them. With --wait, drives that failed are named with the reason.
    """
    which = {"all": every, "stale": stale, "failed": failed or (failure is not None and not (every or stale))}
    filters = {
        "bbox": bbox, "from_method": from_method, "code_version": code_version, "failure": failure,
        "created_after": created_after, "created_before": created_before, "driven_after": driven_after,
        "driven_before": driven_before, "region": region,
    }  # fmt: skip
    selection = [("which", name) for name, chosen in which.items() if chosen]
    narrowed = {name: value for name, value in filters.items() if value is not None}
    _check_choice(len(selection), bool(narrowed) or dry_run or force, bool(drive) + (cancel is not None))
    positioning = _positioning(gnss, gnss_option or [], named=bool(drive))
    console: Console = ctx.obj
    with service_client(server, key, data_dir) as client, console.progress() as bars:
        if drive:
            batch = _each(client, drive, positioning | ({} if method is None else {"method": method}), wait)
        elif cancel is not None:
            batch = Batch.read(
                client.request("DELETE", _ADDRESS, params={"batch": cancel}).json(), str(cancel)
            )
            tell(
                "again.cancelled",
                batch=cancel,
                running=batch.running,
                done=batch.done,
                failed=batch.failed,
            )
        else:
            forced = {"force": "true"} if force else {}
            batch = _ask(client, dict(selection) | narrowed | forced, method, dry_run)
            if wait and batch.number:
                batch = _follow(client, batch, bars.work("reprocessing"))
    if wait and not dry_run:
        tell("again.ended", done=batch.done, failed=batch.failed)
        _tell_failures(console, batch)
    write_json(json_file, {"server": client.server, **asdict(batch)})
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
    failures: list[dict[str, Any]] = field(default_factory=list)
    """The drives that failed, as the service describes them."""

    @classmethod
    def read(cls, document: dict[str, Any], number: str) -> Batch:
        """Build from the batch's JSON document."""
        counts: dict[str, Any] = {
            name: int(document[name]) for name in ("drives", "running", "done", "failed")
        }
        return cls(number, **counts)


def _check_choice(kinds: int, narrowed: bool, named: int) -> None:
    """``typer.BadParameter`` for what contradicts itself: drives and batches that are named need no filter."""
    if kinds + named > 1 or (named and narrowed):
        raise typer.BadParameter(
            spoken(say("again.choose")),
            param_hint="'--all', '--stale', '--failed', '--drive', '--cancel'",
        )


def _ask(client: Client, selection: dict[str, str], method: str | None, dry_run: bool) -> Batch:
    more = {"method": method, "dry_run": "true" if dry_run else None}
    params = selection | {name: value for name, value in more.items() if value is not None}
    answer = client.request("POST", _ADDRESS, params=params)
    document = answer.json()
    if dry_run:
        tell("again.would", n=document["queued"])
        _note(document)
        return Batch(None, int(document["queued"]))
    number = answer.headers["Location"].rpartition("=")[2]
    rest = "" if document["complete"] else say("again.rest")
    tell("again.batch", n=document["queued"], rest=rest, number=number)
    _note(document)
    return Batch(number, int(document["queued"]))


def _note(document: dict[str, Any]) -> None:
    """Why drives were left out, or none was chosen."""
    if document.get("note"):
        typer.echo(spoken(with_key(document["note"], document.get("note_said"))))


def _tell_failures(console: Console, batch: Batch) -> None:
    """Name each that failed, once."""
    if batch.failures:
        failures_table(console, batch.failures)
    if len(batch.failures) < batch.failed:
        rest = batch.failed - len(batch.failures)
        tell("again.more", n=rest, batch=batch.number)


def _follow(client: Client, batch: Batch, show: Progress) -> Batch:
    """Look at the batch until nothing of it is left to do."""
    while True:
        document = client.request("GET", _ADDRESS, params={"batch": batch.number}).json()
        batch = Batch.read(document, str(batch.number))
        show(say("again.at", n=batch.done + batch.failed, all=batch.drives), document["progress"])
        if document["state"] in {"done", "cancelled"} and not batch.running:
            of_it = {"status": "failed", "batch": batch.number}
            failures = listed(client, of_it, SHOWN_FAILURES) if batch.failed else []
            return replace(batch, failures=failures)
        time.sleep(POLL_S)


def _positioning(gnss: str | None, gnss_option: list[str], *, named: bool) -> dict[str, Any]:
    """The query for another positioning; ``typer.BadParameter`` unless drives are named, since a batch knows none."""
    options = parse_assignments(gnss_option, "--gnss-option")
    if not named and (gnss or options):
        raise typer.BadParameter(spoken(say("again.gnss")), param_hint="'--gnss'")
    query: dict[str, Any] = {"gnss": gnss} if gnss else {}
    if options:
        query["gnss_option"] = [f"{name}:{json.dumps(value)}" for name, value in options.items()]
    return query


def _each(client: Client, ids: list[str], query: dict[str, Any], wait: bool) -> Batch:
    """Ask for drives one by one."""
    for one in ids:
        client.request("POST", f"/v1/drives/{one}/reprocess", params=query)
    tell("again.some", n=len(ids))
    ended = [client.wait(one) for one in ids] if wait else []
    failures = [one.document for one in ended if one.status != "done"]
    return Batch(None, len(ids), done=len(ended) - len(failures), failed=len(failures), failures=failures)
