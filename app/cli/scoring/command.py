"""``versant score``: how good the grades of a profile are, by length, beside the elevation model and raw altitudes."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

import app.cli.options as cli
from app.cli.console import Console, spoken, tell, write_json
from app.core.messages import say
from app.core.text import whole_file

if TYPE_CHECKING:
    from fusion.scoring.grades import GradeScore
    from fusion.scoring.profiles import Heights, Reference
    from fusion.types import Floats

app = typer.Typer(add_completion=False)

ELEVATION_MODEL, LEVEL, RAW = "elevation model", "level road", "raw altitudes"
HEADS = ("source", "length m", "stretches", "coverage %", "rms %", "median %", "bias %", "95 %", "rise rms m")


@dataclass(frozen=True)
class Source:
    """Heights along the reference, with where they come from and what is said of how they lie there."""

    name: str
    heights: Heights | None
    """None: of a level road."""
    figures: Mapping[str, Any]


Scored = tuple[Source, "list[GradeScore]"]
"""A source with its score for each length."""


@app.command("score")
def score(
    ctx: typer.Context,
    profiles: list[Path] | None = cli.arg(
        "Height profiles: CSV (distance_m or lat_deg, lon_deg; height_m), GeoJSON, GPX, a router's answer to /height, "
        "or any log.",
        default=None,
        metavar="[PROFILE]...",
    ),
    reference: str = cli.opt(
        "Surveyed heights: a file in one of these forms (a CSV may have sigma_m), or one that is made: town-1, town-2 "
        "or town-3, the road under a route through the town of `versant simulate --seed` 1, 2 or 3.",
        "--reference",
        default=...,
        metavar="NAME|FILE",
    ),
    dem: list[Path] | None = cli.opt(
        "Elevation rasters to be compared as well; may be given several times. Default: those of a made reference.",
        "--dem",
        metavar="FILE",
    ),
    raw: Path | None = cli.opt(
        "The log that a profile was computed from: its altitudes are compared as well.",
        "--raw",
        metavar="LOG",
    ),
    length: list[float] | None = cli.opt(
        "Length of the stretches whose grades are compared; may be given several times.  [default: 50, 100, 200, 500, "
        "1000]",
        "--length",
        metavar="METRES",
        min=1.0,
    ),
    radius_m: float = cli.opt(
        "As far beside the reference a place may lie.", "--radius", default=30.0, metavar="METRES", min=0.1
    ),
    write: Path | None = cli.written_file(
        "--write",
        help="Write the reference itself as a CSV: what a router may be asked along.",
        metavar="FILE",
    ),
    json_file: Path | None = cli.JSON_FILE,
) -> None:
    """Measure height profiles of any program against surveyed heights: errors of grade by length.

    A profile is laid onto the reference by its places, in their order, in either direction; without places by its
    distances. Stretches of each length are compared that begin every half of it: the grade between both ends. Errors
    are percent of grade: root mean square, median of the absolute, mean, and what 95 % do not exceed. A level road
    shows how steep the reference is.
    """
    from fusion.scoring.grades import LENGTHS_M, grade_scores

    console: Console = ctx.obj
    named = _reference(reference)
    if write is not None:
        _write(named, write)
        tell("score.written", file=write, km=(named.along_m[-1] - named.along_m[0]) / 1000)
    sources = [_placed(path, str(path), named, radius_m) for path in profiles or ()]
    with _elevation(reference, dem) as rasters:
        if rasters and named.places_deg is not None:
            sources.append(_modelled(named, named.places_deg, rasters))
    if raw is not None:
        sources.append(_placed(raw, RAW, named, radius_m))
    sources.append(Source(LEVEL, None, {}))
    lengths = sorted(set(length or LENGTHS_M))
    scored = [(one, [*grade_scores(named, one.heights, lengths)]) for one in sources]
    if not any(row.possible for row in scored[-1][1]):
        raise typer.BadParameter(spoken(say("score.short", name=named.name)), param_hint="'--reference'")
    _show(console, scored)
    write_json(json_file, _figures(named, scored))


def _reference(name: str) -> Reference:
    """A made reference by its name, else that of a file."""
    from app.cli.scoring.reading import read_profile
    from fusion.errors import UnknownNameError
    from fusion.scoring.made import SEEDS, made_reference
    from fusion.scoring.profiles import Reference

    if name in SEEDS:
        return Reference.of(name, made_reference(name))
    path = Path(name)
    if not path.exists():
        with cli.naming("--reference"):
            raise UnknownNameError(say("score.no_reference", name=name, names=", ".join(SEEDS)))
    return Reference.of(path.name, read_profile(path))


def _placed(path: Path, name: str, reference: Reference, radius_m: float) -> Source:
    """A profile on the reference; says how much of it lies there."""
    from app.cli.scoring.reading import read_profile
    from fusion.scoring.grades import height_offset_m
    from fusion.scoring.placing import placed
    from fusion.scoring.profiles import PROFILE_GAP_M

    profile = read_profile(path)
    on = placed(reference, profile, path.name, radius_m)
    heights = on.heights(profile.height_m, PROFILE_GAP_M)
    offset_m = height_offset_m(reference, heights)
    figures = {
        "file": str(path),
        "matched_share": on.share,
        "beside_m": on.beside_m,
        "backwards": on.backwards,
        "offset_m": offset_m,
    }
    by_places = reference.places_deg is not None and profile.places_deg is not None
    key = "score.by_places" if by_places else "score.by_distance"
    where = {"beside": on.beside_m} if by_places else {}
    tell(key, name=spoken(name), share=on.share, reference=reference.name, offset=offset_m, **where)
    return Source(name, heights, figures)


@contextmanager
def _elevation(reference: str, dem: Sequence[Path] | None) -> Iterator[list[Path]]:
    """The rasters that are named, else those of a made reference's town while the block runs."""
    from fusion.scoring.made import SEEDS, made_elevation

    if dem or reference not in SEEDS:
        yield [*(dem or ())]
        return
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "dem.tif"
        made_elevation(reference, path)
        yield [path]


def _modelled(reference: Reference, places_deg: Floats, rasters: list[Path]) -> Source:
    """The elevation model under the reference's points."""
    from fusion.scoring.grades import height_offset_m
    from fusion.scoring.profiles import REFERENCE_GAP_M, Heights
    from fusion.terrain.dem import Dem

    with Dem.open(rasters, trusted=True) as terrain:
        height = terrain.heights(*places_deg.T)
        heights = Heights.of(reference.along_m, height, REFERENCE_GAP_M)
        figures = {"rasters": terrain.description, "offset_m": height_offset_m(reference, heights)}
    return Source(ELEVATION_MODEL, heights, figures)


def _show(console: Console, scored: Sequence[Scored]) -> None:
    """The lengths one after the other, each source a row."""
    rows = [
        (
            source.name,
            f"{one.length_m:g}",
            one.stretches,
            100 * one.coverage,
            one.rms_percent,
            one.median_percent,
            one.bias_percent,
            one.p95_percent,
            one.rise_rms_m,
        )
        for by_length in zip(*([(source, one) for one in scores] for source, scores in scored), strict=True)
        for source, one in by_length
        if one.possible
    ]
    console.table(HEADS, rows)


def _figures(reference: Reference, scored: Sequence[Scored]) -> dict[str, Any]:
    of_reference = {
        "name": reference.name,
        "points": len(reference.along_m),
        "known_m": reference.heights.known_m,
        "sigma_m": reference.sigma_m,
    }
    return {
        "reference": of_reference,
        "sources": [
            {
                "name": source.name,
                **source.figures,
                "lengths": [asdict(row) | {"coverage": row.coverage} for row in scores],
            }
            for source, scores in scored
        ],
    }


def _write(reference: Reference, path: Path) -> None:
    """The reference in the form in which references are read."""
    columns = {"distance_m": (reference.along_m, 2), "height_m": (reference.heights.height_m, 3)}
    if reference.places_deg is not None:
        columns |= {"lat_deg": (reference.places_deg[:, 1], 8), "lon_deg": (reference.places_deg[:, 0], 8)}
    with whole_file(path) as partial, partial.open("w", encoding="utf-8") as file:
        file.write(",".join(columns) + "\n")
        rows = zip(*(values.tolist() for values, _ in columns.values()), strict=True)
        digits = [n for _, n in columns.values()]
        file.writelines(
            ",".join(f"{v:.{n}f}" for v, n in zip(row, digits, strict=True)) + "\n" for row in rows
        )
