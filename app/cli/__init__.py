"""The command line, ``versant``: one file per group of commands, loaded only when its command is named.

It answers at once: a file of commands imports at its head what describes them, and inside a command what that
one needs to run. ``versant --help`` imports none of these files.
"""

from __future__ import annotations

import importlib
import os
from collections.abc import Iterator, Mapping
from typing import Annotated, Any, NamedTuple

import typer
from typer.core import TyperCommand, TyperGroup

from app.cli.console import Console, language, sentence
from app.cli.words.parser import in_words, paragraphs, speak, usage_in_words
from fusion.messages import speaking


class Command(NamedTuple):
    """Where a command stands, and the sentence that ``versant --help`` says of it."""

    module: str
    summary: str
    """The first paragraph of the command's docstring (a test holds the two equal)."""


COMMANDS = {
    "demo": Command(
        "app.demo.command",
        "Simulate a town and drives, run them through a service of its own, and compare with the truth.",
    ),
    "up": Command(
        "app.cli.service",
        "Start everything: embedded PostgreSQL + PostGIS, migrations, API and worker. Ctrl-C stops it.",
    ),
    "api": Command("app.cli.service", "Serve the HTTP API."),
    "worker": Command(
        "app.cli.service", "Process uploaded drives. Any number of workers may share one database."
    ),
    "migrate": Command(
        "app.cli.service",
        "Bring the database to the schema of this version. Programs before it run on where the changelog says so.",
    ),
    "import-roads": Command(
        "app.cli.imports",
        "Make the drivable roads of an OpenStreetMap file those of a region; other regions stay as they are.",
    ),
    "regions": Command("app.cli.imports", "List the regions of the road network, or remove one."),
    "import-dem": Command(
        "app.cli.imports", "Add elevation rasters to the terrain that drives and roads are compared with."
    ),
    "import-control": Command(
        "app.cli.imports", "Add surveyed heights to what the network's heights rest on."
    ),
    "upload": Command(
        "app.cli.remote", "Upload drive logs to a service; exit status 1 if any of them failed."
    ),
    "drives": Command(
        "app.cli.drives.again",
        "List, show, delete or process again the drives of a service.",
    ),
    "settle": Command(
        "app.cli.imports", "Compute the slopes of the whole network anew from what the drives contributed."
    ),
    "release": Command(
        "app.cli.upkeep", "Make the next edition of the map for the public, which gives no owner away."
    ),
    "repeats": Command(
        "app.cli.imports",
        "Show what repeated drives say of each other's sigmas; widen those that they contradict.",
    ),
    "elevation": Command("app.cli.elevation", "List, rank or remove the elevation rasters that are in use."),
    "keys": Command(
        "app.cli.keys.commands", "Make, list, revoke or renew the keys of a service, or log a browser in."
    ),
    "backup": Command(
        "app.cli.upkeep", "Copy the database, the logs and the elevation rasters of a running service."
    ),
    "restore": Command("app.cli.upkeep", "Bring a backup back into an empty database."),
    "doctor": Command("app.cli.upkeep", "Look for what is wrong with a service; changes nothing."),
    "sweep": Command(
        "app.cli.upkeep",
        "Remove stored logs that no drive refers to any more, and files that no export does.",
    ),
    "fuse": Command(
        "app.cli.fuse",
        "Fuse logs with roads and terrain into segment slopes, without a server or a database.",
    ),
    "batch": Command(
        "app.batch.command",
        "Fuse archives of logs into segment slopes, without a server or a database.",
    ),
    "import-batch": Command(
        "app.batch.command",
        "Bring the drives of a batch into a service, as if their logs had been uploaded.",
    ),
    "export-logs": Command(
        "app.batch.command",
        "Write the logs of a service as an archive that `versant batch` reads: a folder for each owner.",
    ),
    "track": Command(
        "app.cli.track", "Write the positions of logs, with their heights and stated accuracies."
    ),
    "gnss-study": Command(
        "app.cli.track",
        "Study the residuals of a drive's satellites: by satellite, by reception, and which law they follow.",
    ),
    "score": Command(
        "app.cli.scoring.command",
        "Measure height profiles of any program against surveyed heights: errors of grade by length.",
    ),
    "simulate": Command(
        "app.cli.simulate",
        "Make a hilly town (town.osm, dem.tif), drives through it, and their true slopes (truth.csv).",
    ),
    "export": Command(
        "app.cli.export",
        "Write every segment with its slope, as it stands at one moment, to a file, or draw a map of them.",
    ),
    "hpms": Command(
        "app.cli.sections",
        "Write how many miles of each section lie in the grade classes A to F of HPMS.",
    ),
    "methods": Command(
        "app.cli.methods",
        "List methods with source, needs and options, then formats, windows, resamplers and the like.",
    ),
}
"""In the order of ``versant --help``; the module's ``app`` (a Typer) holds the command."""

GLOBAL_FLAGS = ("--debug", "--quiet")


FORMER_NAMES = {"rebuild": "settle"}
"""Scripts may still call commands so."""


class _LazyCommands(Mapping[str, Any]):
    """Imports a command's module when it is first looked up: ``versant upload`` need not wait for numba."""

    def __getitem__(self, name: str) -> Any:
        name = FORMER_NAMES.get(name, name)
        commands = importlib.import_module(COMMANDS[name].module).app
        loaded: Any = typer.main.get_command(commands)
        return in_words(loaded.commands[name] if isinstance(loaded, TyperGroup) else loaded)

    def __iter__(self) -> Iterator[str]:
        return iter(COMMANDS)

    def __len__(self) -> int:
        return len(COMMANDS)


class VersantGroup(TyperGroup):
    """The root command: lazy subcommands, global flags accepted anywhere, errors told in one line."""

    def __init__(self, **attributes: Any) -> None:
        super().__init__(**attributes)
        lazy: Any = _LazyCommands()
        self.commands = lazy

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Move the global flags to the front: ``versant fuse --quiet`` means ``versant --quiet fuse``."""
        end = args.index("--") if "--" in args else len(args)
        flags = [a for a in args[:end] if a in GLOBAL_FLAGS]
        rest = [a for a in args[:end] if a not in GLOBAL_FLAGS]
        return super().parse_args(ctx, flags + rest + args[end:])

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Write the help out of ``COMMANDS``: the commands themselves are not loaded for it."""
        loading = self.commands
        self.commands = {
            name: TyperCommand(name, help=paragraphs(it.summary)) for name, it in COMMANDS.items()
        }
        try:
            super().format_help(ctx, formatter)
        finally:
            self.commands = loading

    def invoke(self, ctx: Any) -> Any:
        """Run the command; any error becomes one line on standard error and exit status 1."""
        try:
            return super().invoke(ctx)
        except typer.TyperException as error:
            told = usage_in_words(error.format_message())
            error.format_message = lambda: told  # type: ignore[method-assign]
            raise
        except (typer.Exit, typer.Abort, BrokenPipeError):
            raise
        except KeyboardInterrupt:
            raise typer.Exit(130) from None
        except Exception as error:
            if ctx.params.get("debug"):
                raise
            Console().complain(sentence(error))
            raise typer.Exit(1) from error


app = typer.Typer(
    cls=VersantGroup,
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    help="Measures the slope of roads from what vehicles recorded.",
    epilog="--debug and --quiet may stand anywhere. Exit status: 0 done, 1 failed, 2 wrong usage.",
)


def _print_version(is_asked: bool) -> None:
    if is_asked:
        from app.core.version import code_version

        typer.echo(f"versant {code_version()}")
        raise typer.Exit


@app.callback()
def root(
    ctx: typer.Context,
    debug: Annotated[bool, typer.Option("--debug", help="Show where an error came from.")] = False,
    quiet: Annotated[bool, typer.Option("--quiet", help="No progress bars, no notes.")] = False,
    _version: Annotated[
        bool,
        typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version and exit."),
    ] = False,
) -> None:
    """Measures the slope of roads from what vehicles recorded."""
    ctx.with_resource(speaking(language()))
    ctx.obj = Console(quiet=quiet, debug=debug)


def main() -> None:
    """The console script."""
    # Threads of the compiled loops that wait must sleep, not spin: API, database and worker share the cores.
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    speak()
    in_words(typer.main.get_command(app))(prog_name="versant")
