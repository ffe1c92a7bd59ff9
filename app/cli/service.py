"""``versant up``: the whole service in one process tree; ``api``, ``worker``, ``migrate``: its parts."""

from __future__ import annotations

import logging
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from app.cli.console import Console, LogConsole, spoken
from app.cli.database import database, open_cluster, settings_for
from app.cli.options import DATA_DIR, flag, opt
from app.core.messages import say

if TYPE_CHECKING:
    from app.cli.supervisor import Service
    from app.core.settings import Settings

GRACEFUL_S = 3  # followers of a drive's events would otherwise keep a stopping server open

app = typer.Typer(add_completion=False)

WITH_PARENT = flag("Stop when standard input closes.", "--stop-with-parent", hidden=True)


@app.command("up")
def up(
    ctx: typer.Context,
    data_dir: Path | None = opt(
        "Folder of the database, the uploads and the rasters; made if it is missing. "
        "Default: VERSANT_DATA_DIR, else ~/.local/share/versant.",
        metavar="DIR",
        file_okay=False,
    ),
    port: int | None = opt("TCP port, 0 for any free one.  [default: 8000]", min=0, max=65535),
    host: str | None = opt("Address to listen on.  [default: 127.0.0.1, this machine alone]"),
) -> None:
    """Start everything: embedded PostgreSQL + PostGIS, migrations, API and worker. Ctrl-C stops it.

    While it runs, `versant import-roads`, `import-dem`, `export` (with the same --data-dir) and `upload` work
    beside it.
    """
    from app.cli.children import stop_signals
    from app.cli.keys.starting import first_link
    from app.cli.supervisor import Service

    settings = settings_for(data_dir, port=port, host=host)
    console = _voice(ctx, settings, "supervisor")
    with stop_signals():
        console.note(say("up.starting", folder=settings.data_dir))
        with open_cluster(settings) as cluster:
            ready = settings.model_copy(update={"database_url": cluster.url})
            token = first_link(ready)
            with Service(ready, console, cluster=cluster) as service:
                typer.echo("\n".join(welcome(service, settings, token)))
                service.serve_forever()
    console.note(say("up.stopped"))


@app.command("api")
def api(
    ctx: typer.Context,
    data_dir: Path | None = DATA_DIR,
    port: int | None = opt("TCP port.  [default: 8000]", min=0, max=65535),
    host: str | None = opt("Address to listen on.  [default: 127.0.0.1]"),
    with_parent: bool = WITH_PARENT,
) -> None:
    """Serve the HTTP API."""
    import uvicorn

    from app.cli.children import stop_with_parent
    from app.cli.keys.starting import see_to_key
    from app.cli.supervisor import free_port, reach
    from app.core.middleware import stay_loaded
    from app.core.receiving.connections import server_options
    from app.core.telemetry.logs import begin_logging
    from app.core.telemetry.tracing import begin_tracing, end_tracing
    from app.main import create_app

    console: Console = ctx.obj
    settings = settings_for(data_dir, port=port, host=host)
    begin_logging(settings, "api")
    if with_parent:
        stop_with_parent()
    begin_tracing(settings, "api")
    with database(settings) as ready:
        _require_database(ready, migrated=False)  # until it is, /readyz says so
        if settings.database_url is None:  # a server of its own gets its first key by `versant keys create`
            see_to_key(ready)
        number = free_port(ready)
        if not with_parent:
            console.note(say("up.listens", host=ready.host, port=number, reach=reach(ready)))
        application = create_app(ready)
        stay_loaded()
        uvicorn.run(
            application,
            host=ready.host,
            port=number,
            log_config=None,
            **server_options(ready),
            timeout_graceful_shutdown=GRACEFUL_S,
        )
        end_tracing()


@app.command("worker")
def worker(
    ctx: typer.Context,
    data_dir: Path | None = DATA_DIR,
    concurrency: int | None = opt(
        "Drives computed at once, each in a process of its own.  [default: as cores and memory allow]", min=1
    ),
    with_parent: bool = WITH_PARENT,
) -> None:
    """Process uploaded drives. Any number of workers may share one database."""
    from app.cli.children import Children, stop_signals, workers

    settings = settings_for(data_dir, worker_concurrency=concurrency)
    console = _voice(ctx, settings, "workers")
    if with_parent:  # and with a database that the parent has found or started
        from app.cli.lanes import serve

        with stop_signals():
            serve(settings, console, partial(_require_database, migrated=True))
        return
    with database(settings) as ready:
        _require_database(ready, migrated=True)
        with stop_signals(), Children(ready, console, [workers(ready)]) as children:
            children.look_after_all()


@app.command("migrate")
def migrate(
    ctx: typer.Context,
    data_dir: Path | None = DATA_DIR,
    finish: bool = flag(
        "Also take away what only programs of older versions use: when none runs any more.", "--finish"
    ),
) -> None:
    """Bring the database to the schema of this version. Programs before it run on where the changelog says so."""
    from app.core import migrate as migrations

    console: Console = ctx.obj
    settings = settings_for(data_dir)
    with database(settings) as ready:
        assert ready.session_url is not None  # noqa: S101 - database() sees to it
        logging.basicConfig(level=logging.WARNING, format="%(message)s")
        migrations.upgrade(ready.session_url, finish=finish)
        revision = migrations.standing_of(ready.session_url).revision
    console.note(say("migrate.at", revision=revision))


def _require_database(settings: Settings, *, migrated: bool) -> None:
    """Raise unless the database is there and, with ``migrated`` or where it is newer, fits this program."""
    from app.core.databases import require_reachable
    from app.core.migrate import standing_of

    assert settings.database_url is not None  # noqa: S101 - database() sees to it
    require_reachable(settings.database_url)
    standing = standing_of(settings.database_url)
    if migrated or standing.newer:
        standing.demand()


def _voice(ctx: typer.Context, settings: Settings, process: str) -> Console:
    """What looks after the others speaks to a person, unless every line is to be JSON."""
    console: Console = ctx.obj
    if settings.log_format != "json":
        return console
    from app.core.telemetry.logs import begin_logging

    begin_logging(settings, process)
    return LogConsole(quiet=console.quiet, debug=console.debug)


def welcome(service: Service, settings: Settings, token: str | None) -> list[str]:
    """What to open and what to do next; ``token`` is that of a login link, None where no keys are asked for."""
    from app.cli.keys.commands import login_address
    from app.cli.supervisor import reach

    home = f"--data-dir {settings.data_dir}"
    server = f"--server {service.address}"
    opened = f"{service.address}/map"
    if token is not None:
        again = f"versant keys link {home} {server}"
        opened = say("up.link", address=login_address(service.address, token), again=again)
    lines = [
        say("up.ready", address=service.address, docs=service.address),
        say("up.map", opened=opened),
        reach(settings),
        f"  versant import-roads {home} FILE.osm.pbf",
        f"  versant import-dem {home} FILE...",
        f"  versant upload {server} {home} --wait LOG...",
        say("up.stops"),
    ]
    return [spoken(line) for line in lines]
