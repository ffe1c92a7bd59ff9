"""The parts of a deployment: ``versant api``, ``versant worker``, ``versant migrate``."""

from __future__ import annotations

import logging
from typing import Annotated

import typer
import uvicorn

from app.cli.console import Console
from app.cli.database import database, settings_for
from app.cli.options import DataDir
from app.cli.supervisor import free_port, reach, stop_with_parent
from app.core import migrate as migrations
from app.core.databases import require_reachable
from app.core.settings import Settings
from app.drives.worker import run_worker
from app.main import create_app

GRACEFUL_S = 3  # followers of a drive's events would otherwise keep a stopping server open

app = typer.Typer(add_completion=False)

WithParent = Annotated[
    bool, typer.Option("--stop-with-parent", hidden=True, help="Stop when standard input closes.")
]


@app.command("api")
def api(
    ctx: typer.Context,
    data_dir: DataDir = None,
    port: Annotated[int | None, typer.Option(min=0, max=65535, help="TCP port.  [default: 8000]")] = None,
    host: Annotated[str | None, typer.Option(help="Address to listen on.  [default: 127.0.0.1]")] = None,
    with_parent: WithParent = False,
) -> None:
    """Serve the HTTP API."""
    console: Console = ctx.obj
    settings = settings_for(data_dir, port=port, host=host)
    _begin(settings, with_parent)
    with database(settings, embedded=True if data_dir else None) as ready:
        _require_database(ready)
        number = free_port(ready)
        if not with_parent:
            console.note(f"Versant's API listens on {ready.host}:{number}. {reach(ready)}")
        uvicorn.run(
            create_app(ready),
            host=ready.host,
            port=number,
            log_config=None,
            access_log=False,
            timeout_graceful_shutdown=GRACEFUL_S,
        )


@app.command("worker")
def worker(
    ctx: typer.Context,
    data_dir: DataDir = None,
    concurrency: Annotated[
        int | None, typer.Option(min=1, help="Drives computed at once.  [default: 1]", show_default=False)
    ] = None,
    with_parent: WithParent = False,
) -> None:
    """Process uploaded drives. Any number of workers may share one database."""
    settings = settings_for(data_dir, worker_concurrency=concurrency)
    _begin(settings, with_parent)
    with database(settings, embedded=True if data_dir else None) as ready:
        _require_database(ready)
        run_worker(ready)


@app.command("migrate")
def migrate(ctx: typer.Context, data_dir: DataDir = None) -> None:
    """Bring the database to the schema of this version."""
    console: Console = ctx.obj
    settings = settings_for(data_dir)
    with database(settings, embedded=True if data_dir else None) as ready:
        assert ready.database_url is not None  # noqa: S101 - database() sees to it
        migrations.upgrade(ready.database_url)
    console.note(f"The database is at revision {migrations.latest_revision()}.")


def _require_database(settings: Settings) -> None:
    assert settings.database_url is not None  # noqa: S101 - database() sees to it
    require_reachable(settings.database_url)


def _begin(settings: Settings, with_parent: bool) -> None:
    logging.basicConfig(level=settings.log_level, format="%(asctime)s %(levelname)s %(name)s: %(message)s")
    # Every request that the queue or a client library makes is of interest only while it is debugged.
    for chatty in ("procrastinate", "uvicorn", "httpx", "alembic", "matplotlib"):
        logging.getLogger(chatty).setLevel(max(logging.WARNING, logging.getLevelName(settings.log_level)))
    if with_parent:
        stop_with_parent()
