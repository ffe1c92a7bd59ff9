"""``versant track`` and ``gnss-study``: the positions of logs, and what the residuals of satellites say of them."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

import app.cli.options as cli
from app.cli.console import Console, part_of, spoken, tell, write_json
from app.cli.logs.named import LogFiles, base_of, drives_of, sorted_drives
from app.core.messages import say
from app.core.text import whole_file
from fusion.errors import FusionError, MissingSensorError
from fusion.registry import DEFAULT_POSITIONING

if TYPE_CHECKING:
    from app.cli.logs.positions import Positions
    from fusion.gnss.positioning import Positioned
    from fusion.published.positioning.study import Study
    from fusion.types import Progress

app = typer.Typer(add_completion=False)


@app.command("track")
def track(
    ctx: typer.Context,
    logs: list[Path] = cli.LOG_NAMES,
    out: Path = cli.written_file("-o", "--out", help="Positions: .csv or .geojson.", default=...),
    gnss: str = cli.gnss_name(DEFAULT_POSITIONING),
    gnss_option: list[str] | None = cli.GNSS_OPTION,
    base: list[Path] | None = cli.BASE,
    base_place: str | None = cli.BASE_PLACE,
    columns: list[str] | None = cli.COLUMNS_OPTION,
    together: bool = cli.TOGETHER,
    apart: bool = cli.APART,
    json_file: Path | None = cli.JSON_FILE,
) -> None:
    """Write the positions of logs, with their heights and stated accuracies.

    A log that fails is reported, and the others go on.
    """
    from app.cli.logs.positions import TRACK_WRITERS, Positions

    console: Console = ctx.obj
    _usable(out, "track", TRACK_WRITERS)
    named = cli.parse_columns(columns)
    options = cli.positioning_options(gnss, gnss_option)
    tracks: list[Positions] = []
    outcomes = []
    with console.progress() as bars:
        station = base_of(base, base_place)
        drives = sorted_drives(logs, console, together=together, apart=apart, columns=named, base=station)
        for source in drives:
            outcome = {"file": source.name, "positions": 0, "reason": None, "gnss": {}, "warnings": []}
            try:
                one = _positioned(source, gnss, options, bars.work(source.short_name), named)
            except (FusionError, OSError) as error:
                outcome["reason"] = console.complain_of(source.name, error)
            else:
                tracks.append(Positions(source.short_name, one))
                console.warn(source.name, one.log.warnings)
                outcome |= {
                    "positions": len(one.log.fix),
                    "gnss": one.report,
                    "warnings": list(one.log.warnings),
                }
            outcomes.append(outcome)
    if tracks:
        with whole_file(out) as partial:
            TRACK_WRITERS[out.suffix.lower()](tracks, partial)
        tell(
            "track.written",
            file=out,
            n=sum(len(t.log.fix) for t in tracks),
            logs=len(tracks),
            all=len(drives),
        )
    write_json(json_file, {"gnss": gnss, "logs": outcomes})
    if len(tracks) < len(drives):
        raise typer.Exit(1)


def _usable(out: Path, what: str, suffixes: Collection[str]) -> None:
    """Refuse, before any work, a suffix that nothing is written to."""
    if out.suffix.lower() not in suffixes:
        raise typer.BadParameter(
            spoken(say("track.no_suffix", what=what, suffix=out.suffix, names=" or ".join(suffixes))),
            param_hint="'--out'",
        )


def _positioned(
    source: LogFiles,
    gnss: str,
    options: Mapping[str, Any],
    progress: Progress,
    columns: Mapping[str, str] | None = None,
) -> Positioned:
    """Read a log and compute its positions."""
    from fusion.gnss.positioning import positioned

    log = source.read(part_of(progress, 0.0, 0.3), columns)
    return positioned(log, gnss, options, part_of(progress, 0.3, 1.0))


@app.command("gnss-study")
def gnss_study(
    ctx: typer.Context,
    logs: list[Path] = cli.arg(
        "The files of one drive, such as observations and navigation; or a folder or a zip of them.",
        metavar="LOG...",
    ),
    gnss: str = cli.gnss_name("one-sided"),
    gnss_option: list[str] | None = cli.GNSS_OPTION,
    base: list[Path] | None = cli.BASE,
    base_place: str | None = cli.BASE_PLACE,
    out: Path | None = cli.written_file("-o", "--out", help="A picture, .png."),
    json_file: Path | None = cli.JSON_FILE,
) -> None:
    """Study the residuals of a drive's satellites: by satellite, by reception, and which law they follow."""
    from fusion.published.positioning.study import study

    console: Console = ctx.obj
    if out is not None:
        _usable(out, "picture", [".png"])
    options = cli.positioning_options(gnss, gnss_option)
    with console.progress() as bars:
        (drive,) = drives_of(logs, together=True, base=base_of(base, base_place))
        computed = _positioned(drive, gnss, options, bars.work(drive.short_name))
    console.warn(drive.name, computed.log.warnings)
    if computed.measured is None or computed.solution is None:
        raise MissingSensorError(
            say("track.no_residuals", gnss=gnss),
            where="gnss",
        )
    result = study(computed.measured, computed.solution)
    _print_study(console, result)
    if out is not None:
        from app.drives.outputs.gnss_picture import gnss_png

        title = f"{drive.short_name}, {computed.name}"
        out.write_bytes(gnss_png(computed.measured, computed.solution, result.laws, title))
        tell("track.picture", file=out)
    write_json(json_file, {"gnss": computed.name, "logs": [str(path) for path in logs], **asdict(result)})


def _print_study(console: Console, result: Study) -> None:
    rows = [
        (r.name, r.count, r.mean_m, r.median_m, r.spread_m, r.most_m, r.cn0_dbhz, r.nlos)
        for r in (*result.satellites, *result.states)
    ]
    heads = ("", "residuals", "mean m", "median m", "spread m", "largest m", "C/N0 dB-Hz", "reflected")
    console.table(heads, rows, title="Residuals by satellite and by reception")
    laws = []
    for t in result.laws:
        chi2 = f"{t.chi2:.1f} ({t.dof})" if t.dof else None
        laws.append((t.law, f"{t.ks:.4f}", t.ks_taken, chi2, t.chi2_taken))
    if laws:
        tests = ("law", "KS", "taken at 5 %", "chi-square (dof)", "taken at 5 %")
        console.table(tests, laws, title=say("track.laws", most=result.laws[0].ks_critical))
    wins = [(w.window, say("track.over", law=w.law, other=w.other), w.share) for w in result.wins]
    console.table(("window", "nearer by KS", "share"), wins, title="Sliding windows")
