"""``versant upload``: a client of a running service, which it knows by its API alone; ``versant drives`` is another."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

import app.cli.options as cli
from app.cli.console import Bars, Console, spoken, write_json
from app.cli.logs.named import LogFiles, drives_of, unclear_words
from app.cli.uploads.choice import ArchiveChoice, is_archive
from app.cli.uploads.rows import SENT_BEFORE, SHOWN, Upload, shown_status
from app.core.messages import say
from fusion.errors import FusionError
from fusion.messages import message_of

if TYPE_CHECKING:
    from app.cli.client import Client, Sent
    from app.cli.uploads.archives import Archives
    from app.core.settings import Settings

app = typer.Typer(add_completion=False)

GONE = 404

SERVER = cli.opt("Address of the service.  [default: VERSANT_SERVER]", metavar="URL")
KEY = cli.opt(
    "Key that the service is shown.  [default: VERSANT_KEY, else that in its data folder on this machine]",
    "--key",
    metavar="KEY",
)
KEY_DIR = cli.opt(
    "Data folder of the service that is asked, where it is on this machine: for its operator.key.  "
    "[default: VERSANT_DATA_DIR]",
    "--data-dir",
    metavar="DIR",
    file_okay=False,
)
GNSS_CHOICE = cli.opt(
    "How positions are computed (`versant methods` lists the ways); without it as the service does by itself.",
    "--gnss",
    metavar="NAME",
)


@app.command("upload")
def upload(
    ctx: typer.Context,
    files: list[Path] = cli.LOG_NAMES,
    together: bool = cli.TOGETHER,
    apart: bool = cli.APART,
    server: str | None = SERVER,
    key: str | None = KEY,
    data_dir: Path | None = KEY_DIR,
    method: str | None = cli.opt("Estimator; without it the service's default."),
    option: list[str] | None = cli.METHOD_OPTION,
    gnss: str | None = GNSS_CHOICE,
    gnss_option: list[str] | None = cli.GNSS_OPTION,
    columns: list[str] | None = cli.COLUMNS_OPTION,
    wait: bool = cli.flag("Wait until each drive is done or failed.", "--wait"),
    dry_run: bool = cli.flag("Only tell what is in an archive.", "--dry-run"),
    manifest: Path | None = cli.written_file(
        "--manifest", help="Write what each file of an archive is, as a CSV.", metavar="FILE.csv"
    ),
    sports: list[str] | None = cli.opt(
        "Of an archive take this sport, such as running; may be given several times.  "
        "[default: cycling, driving and motorcycling]",
        "--sports",
        metavar="NAME",
    ),
    every_sport: bool = cli.flag("Of an archive take every sport.", "--all"),
    journal: Path | None = cli.opt(
        "Where it is kept what was sent of an archive.  [default: a file in ~/.local/state/versant/uploads]",
        "--journal",
        metavar="FILE",
        dir_okay=False,
    ),
    json_file: Path | None = cli.JSON_FILE,
) -> None:
    """Upload drive logs to a service; exit status 1 if any of them failed.

    A zip becomes as many drives as are in it, each with a line of its own. The same bytes again are the same drive: an
    upload that broke off may simply be repeated. A drive where no roads are waits for them, and has failed for scripts.

    A folder or a zip of more than 32 files, or with zips in it, is an archive: every file in it and below is looked at
    first, what is in it is told, and then what is a drive on roads is sent. The same command again goes on.
    """
    console: Console = ctx.obj
    options = _options(option, gnss_option, columns)
    if together and apart:
        raise typer.BadParameter(spoken(say("options.contradict")), param_hint="'--apart'")
    choice = ArchiveChoice(every_sport, sports, manifest, dry_run, journal)
    if together and choice.is_made:
        raise typer.BadParameter(spoken(say("options.no_archive")), param_hint="'--together'")
    grouping = "one" if together else "apart" if apart else None
    computation = {"method": method, "options": options, "gnss": gnss, "grouping": grouping}
    roots = [] if together else [path for path in files if choice.is_made or is_archive(path)]
    sources = drives_of([path for path in files if path not in roots], together)
    if dry_run:
        with console.progress() as bars:
            archives = _looked(roots, choice, options, console, bars, apart=apart)
        write_json(json_file, {"files": archives.outcomes() if archives else []})
        return
    with service_client(server, key, data_dir) as client, console.progress() as bars:
        client.get("/healthz")  # a service that is not there is said once, not per file
        archives = _looked(roots, choice, options, console, bars, apart=apart)
        uploads = [
            one for source in sources for one in _send(client, source, computation, bars, console, wait=wait)
        ]
        every = uploads + (archives.send(client, computation, bars) if archives else [])
        if wait:
            for one in every:
                _follow(client, one, bars, console)
    rows = [one.figures() for one in every]
    shown = [{**row, "status": shown_status(row["status"], row["waits_for"])} for row in rows[: len(uploads)]]
    figures = {"server": client.server, "uploads": rows}
    if shown or not archives:
        console.table(SHOWN, [[row[name] for name in SHOWN] for row in shown])
    if archives:
        figures["files"] = archives.outcomes()
        archives.tell_outcomes()
    write_json(json_file, figures)
    if any(one.failed for one in every):
        raise typer.Exit(1)


def _options(
    option: list[str] | None, gnss_option: list[str] | None, columns: list[str] | None
) -> dict[str, Any]:
    """Those of the method, with those of the positioning and the columns among them."""
    options = cli.parse_assignments(option, "--option")
    if gnss_option:
        options["gnss_options"] = cli.parse_assignments(gnss_option, "--gnss-option")
    if columns:
        options["columns"] = cli.parse_columns(columns)
    return options


def _looked(
    roots: list[Path],
    choice: ArchiveChoice,
    options: dict[str, Any],
    console: Console,
    bars: Bars,
    *,
    apart: bool,
) -> Archives | None:
    """What is in archives, which is told; None where none is named."""
    if not roots:
        return None
    from app.cli.uploads.archives import Archives

    return Archives.looked_at(roots, choice, options.get("columns", {}), console, bars, apart=apart)


def service_client(server: str | None, key: str | None = None, data_dir: Path | None = None) -> Client:
    """A client of the service that ``--server`` or the settings name, with the key of ``--key`` or what stands for it.

    Raises ``typer.BadParameter`` for an address and for a key that cannot be one.
    """
    from app.cli.client import BadKeyError, Client, ClientError, check_address
    from app.core.settings import Settings, load_settings

    named: dict[str, Any] = {} if data_dir is None else {"data_dir": data_dir}
    settings = load_settings(lambda: Settings(**named))
    address = settings.server if server is None else server
    try:
        check_address(address)
        return Client(address, key=key or _key_of(settings, address))
    except BadKeyError as error:
        raise typer.BadParameter(spoken(message_of(error)), param_hint="'--key' or VERSANT_KEY") from error
    except ClientError as error:
        if server is None:
            raise
        raise typer.BadParameter(spoken(message_of(error)), param_hint="'--server'") from error


def _key_of(settings: Settings, address: str) -> str | None:
    """The key that the environment gives; else that of the data folder, which no other machine is ever shown."""
    from app.access.folder import read_key
    from app.cli.client import is_local

    if settings.key is not None:
        return settings.key.get_secret_value().strip()
    return read_key(settings.data_dir) if is_local(address) else None


def _send(
    client: Client,
    source: LogFiles,
    computation: dict[str, Any],
    bars: Bars,
    console: Console,
    *,
    wait: bool,
) -> list[Upload]:
    """Upload files; ``computation`` is what ``Client.send`` takes beside them. What came of them."""
    from app.cli.client import RefusedKeyError
    from app.cli.uploads.delivering import deliver

    try:
        files = source.files()
        advance = bars.count(
            say("stage.sending", name=source.short_name), sum(path.stat().st_size for path in files)
        )
        sent = deliver(client, tuple(files), computation, sent=advance)
    except RefusedKeyError:
        raise  # said once, not per file
    except (FusionError, OSError) as error:
        return [Upload(source.name, reason=console.complain_of(source.name, error))]
    uploads = _drives_of(source, sent)
    for one in uploads:
        if one.failed and one.drive and not wait:
            _tell_failed(one, console)
    for document in sent.documents:
        doubts = document.get("unclear") or []
        console.warn(source.name, (unclear_words(doubt["files"], doubt["why"]) for doubt in doubts))
    console.warn(
        source.name, (say("logs.left_out", name=one["file"], reason=one["reason"]) for one in sent.left_out)
    )
    return uploads


def _drives_of(source: LogFiles, sent: Sent) -> list[Upload]:
    """A line for each drive; where they are several, also for each file that is in none."""
    if len(sent.drives) == 1:
        return [Upload(source.name, sent.drives[0], sent.drives[0].reason)]
    uploads = [
        Upload(f"{source.name}: {', '.join(document['files'])}", drive, drive.reason)
        for drive, document in zip(sent.drives, sent.documents, strict=True)
    ]
    return uploads + [
        Upload(f"{source.name}: {one['file']}", reason=one["reason"], left_out=one["kind"])
        for one in sent.left_out
    ]


def _follow(client: Client, one: Upload, bars: Bars, console: Console) -> None:
    from app.cli.client import ClientError, RefusedKeyError, shown

    if one.drive is None:
        return
    show = bars.work(say("stage.fusing", name=one.name))
    try:
        one.drive = client.wait(one.drive.id, seen=shown(show))
    except ClientError as error:
        if error.status != GONE or one.status != SENT_BEFORE:
            raise
        console.warn(one.name, [message_of(error)])  # somebody removed it since
        return
    one.reason = one.drive.reason
    if one.drive.status == "done":
        with suppress(RefusedKeyError):  # whoever may upload alone is not shown them
            one.segments = sum(1 for _ in client.features(f"/v1/drives/{one.drive.id}/segments"))
        _tell(one, console)
    elif one.failed:
        _tell_failed(one, console)


def _tell_failed(one: Upload, console: Console) -> None:
    """Say why nothing came of a drive; that it waits for something is no complaint."""
    reason = spoken(one.reason or one.status)
    if one.waits_for:
        console.warn(one.name, [say("cli.two", first=shown_status("failed", one.waits_for), second=reason)])
    else:
        console.complain(f"{one.name}: {reason}")


def _tell(one: Upload, console: Console) -> None:
    """Say what came of a drive, what a person should know of it, and where it can be seen."""
    figures = one.figures()
    console.note(figures["summary"] or say("drives.done", name=one.name))
    console.warn(one.name, figures["warnings"])
    where = [address for address in (figures["address"], figures["profile"]) if address]
    if where:
        key = "drives.see" if len(where) == 1 else "drives.see_both"
        console.note(say(key, name=one.name, where=where[0], profile=where[-1]))
