"""The command line, ``versant``: one file per group of commands, loaded only when its command is named."""

from __future__ import annotations

import importlib
import os
from collections.abc import Iterator, Mapping
from importlib import metadata
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from app.cli.console import Console, sentence

COMMANDS = {
    "demo": "app.cli.demo",
    "up": "app.cli.up",
    "api": "app.cli.service",
    "worker": "app.cli.service",
    "migrate": "app.cli.service",
    "import-roads": "app.cli.imports",
    "import-dem": "app.cli.imports",
    "upload": "app.cli.upload",
    "reprocess": "app.cli.reprocess",
    "rebuild": "app.cli.rebuild",
    "fuse": "app.cli.fuse",
    "track": "app.cli.track",
    "simulate": "app.cli.simulate",
    "export": "app.cli.export",
    "methods": "app.cli.methods",
}
"""Command -> module, in the order of ``versant --help``; the module's ``app`` (a Typer) holds the command."""

GLOBAL_FLAGS = ("--debug", "--quiet")


class _LazyCommands(Mapping[str, Any]):
    """Imports a command's module when it is first looked up: ``versant upload`` need not wait for numba."""

    def __getitem__(self, name: str) -> Any:
        commands = importlib.import_module(COMMANDS[name]).app
        loaded: Any = typer.main.get_command(commands)
        return loaded.commands[name] if isinstance(loaded, TyperGroup) else loaded

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

    def invoke(self, ctx: Any) -> Any:
        """Run the command; any error becomes one line on standard error and exit status 1."""
        try:
            return super().invoke(ctx)
        except (typer.Exit, typer.Abort, typer.TyperException, BrokenPipeError):
            raise
        except KeyboardInterrupt:
            raise typer.Exit(130) from None
        except Exception as error:
            if ctx.params.get("debug"):
                raise
            typer.echo(f"versant: {sentence(error)}", err=True)
            raise typer.Exit(1) from error


app = typer.Typer(
    cls=VersantGroup,
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    help="Measures the slope of roads from what vehicles recorded.",
    epilog="--debug and --quiet may stand anywhere. Exit status: 0 done, 1 failed, 2 wrong usage.",
)


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"versant {version()}")
        raise typer.Exit


def version() -> str:
    """The installed version, or ``unknown`` when run from a tree that was never installed."""
    try:
        return metadata.version("versant")
    except metadata.PackageNotFoundError:
        return "unknown"


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
    ctx.obj = Console(quiet=quiet, debug=debug)


def main() -> None:
    """The console script."""
    # Threads of the compiled loops that wait must sleep, not spin: API, database and worker share the cores.
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    app(prog_name="versant")
