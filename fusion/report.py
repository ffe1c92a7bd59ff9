"""What a drive's report says, whatever the method: figures, and in sentences what a person should know or do.

``report["warnings"]`` is the one place of these sentences: the command line, the service's documents and its pages show
them as they stand. What a reader or a method found by itself it has said in words of its own, which go before those
that are made here. What a report says of other drives changes as they come and go, so it is added when somebody looks
(``with_contradiction``, ``with_duplicate``). Nothing is estimated here.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from pyproj import Geod

from fusion.formats import FORMATS
from fusion.messages import joined, remarks_of, said, say, with_remarks
from fusion.terrain.datum import datum_of_log
from fusion.terrain.height_doubt import height_doubt, off_ground
from fusion.types import CUES, MAX_SPEED_MPS, PAUSE_S, DriveLog, Floats, Track

if TYPE_CHECKING:
    from fusion.methods.base import DriveResult, Method, Options
    from fusion.terrain.dem import Dem

PART_COVERED = 0.9
"""An elevation model that knows the ground under a smaller share of the positions is worth a warning; every model has
voids."""
REJECTED_SHARE = 1 / 3
"""A drive that contradicts the others on more of its segments than this gets a warning."""
FEWEST_ALIKE = 60
"""So many altitudes that are all the same were not measured: what measures them is unsteady on the flattest road."""
MOST_NAMED = 4
"""Rasters that one sentence names."""
MOST_PLACES = 5000
"""Positions of a drive, evenly chosen, at which the elevation model is looked at."""

_WGS84 = Geod(ellps="WGS84")
NO_GROUND = say("drive.no_ground")
NO_HEIGHTS = say("drive.zero_altitudes")
_ADVICE = {
    "altitude": say("advice.altitude"),
    "doppler": say("advice.doppler"),
}


class Ground(NamedTuple):
    """An elevation model under a drive's positions: the share of them that it has a height for, and its heights (n,), m
    (NaN: none), with the rows in the log's table of positions of those that were looked at."""

    share: float
    height_m: Floats
    row: np.ndarray


def ground_under(log: DriveLog, dem: Dem | None) -> Ground | None:
    """What the elevation model knows of the ground under a log; None without a model."""
    if dem is None:
        return None
    fix = log.fix
    row = np.arange(0, len(fix), max(1, -(-len(fix) // MOST_PLACES)))
    height = dem.heights(fix.lon_deg[row], fix.lat_deg[row])
    share = float(np.mean(np.isfinite(height))) if len(row) else 0.0
    return Ground(share, height, row)


def without_placeholders(log: DriveLog) -> DriveLog:
    """The log without altitudes that are all 0, as programs write them that know none, and with a warning of it."""
    altitude = known_altitudes(log)
    if len(altitude) < FEWEST_ALIKE or altitude.any():
        return log
    unknown = np.full(len(log.fix), np.nan)
    return replace(log, fix=replace(log.fix, alt_msl_m=unknown), warnings=(*log.warnings, NO_HEIGHTS))


def known_altitudes(log: DriveLog) -> Floats:
    """The altitudes above sea level that the log has."""
    return log.fix.alt_msl_m[np.isfinite(log.fix.alt_msl_m)]


def drive_report(
    log: DriveLog,
    result: DriveResult,
    method: Method,
    options: Options,
    dem: Dem | None,
    ground: Ground | None,
    *,
    computed: bool,
    graded: bool,
) -> dict[str, Any]:
    """The method's own report with what is the same for every method; JSON-serialisable.

    ``log`` is what the method was given, ``ground`` the elevation model under it. ``computed``: its positions were made
    from raw signals, and their heights left out; ``graded``: slopes could be made of it.
    """
    track = result.track
    sigmas = [slope.slope_sigma_percent for slope in result.slopes]
    only = _rests_on_terrain(log, result, method, ground)
    doubt = _doubt(log, ground, computed=computed)
    return {
        "format": log.source_format,
        "method": method.name,
        "options": options.model_dump(mode="json"),
        "epochs": len(track),
        "duration_s": float(np.ptp(track.time_s)) if len(track) else 0.0,
        "distance_m": track_length_m(track),
        "matched_share": result.report.get("matched_share", _matched_share(track)),
        "segments_driven": len(
            {*track.segment[track.segment >= 0].tolist(), *(s.segment for s in result.slopes)}
        ),
        "segments_estimated": len(result.slopes),
        "segments_in_network": len(result.in_network),
        "median_slope_sigma_percent": float(np.median(sigmas)) if sigmas else None,
        "dem": None if dem is None else dem.description,
        "dem_said": None if dem is None else said(dem.description),
        "dem_datum": None if dem is None else dem.datum,
        "dem_share": None if ground is None else ground.share,
        "dem_only": only,
        "geoid": log.geoid,
        "height_datum": datum_of_log(log),
        "height_doubt": doubt,
        "missing": list(log.missing),
        "skipped": dict(log.skipped),
        "repaired": dict(log.repaired),
        **with_remarks(
            {},
            [
                *log.warnings,
                *result.report.get("warnings", ()),
                *_lacking(log, method, only=only, computed=computed),
                *(_never_changing(log) if "altitude" in method.cues else ()),
                *_of_terrain(log, dem, ground),
                *_below_sea(doubt),
                *(_nothing_came_out(result) if graded else ()),
            ],
        ),
        **{k: v for k, v in result.report.items() if k not in ("matched_share", "warnings", "warnings_said")},
    }


def track_length_m(track: Track) -> float | None:
    """Length of the path through the track's positions, metres; None with fewer than two positions.

    Nothing is counted where the path is interrupted, nor a step that no vehicle can make.
    """
    known = np.isfinite(track.lon_deg) & np.isfinite(track.lat_deg)
    if np.count_nonzero(known) < 2:
        return None
    lon, lat, pause_s = track.lon_deg[known], track.lat_deg[known], np.diff(track.time_s[known])
    step_m = np.asarray(_WGS84.inv(lon[:-1], lat[:-1], lon[1:], lat[1:])[2])
    driven = (pause_s <= PAUSE_S) & ~track.after_outage[known][1:] & (step_m <= MAX_SPEED_MPS * pause_s)
    return float(step_m[driven].sum())


def cues_of(log: DriveLog) -> frozenset[str]:
    """Which of ``CUES`` the log has."""
    has = {
        "altitude": log.fix.has("alt_msl_m") or log.fix.has("height_ell_m"),
        "doppler": log.velocity.has("vel_d_mps"),
        "pitch": log.attitude.has("pitch_rad"),
        "specific force": log.force.has("acc_x_mps2"),
        "barometer": log.pressure.has("pressure_pa"),
    }
    return frozenset(name for name in CUES if has[name])


def advice_of(log: DriveLog, cues: Collection[str], dem: Dem | None, ground: Ground | None) -> str:
    """What to do about a log that lacks what its method needs: which of ``cues`` a person with that kind of device
    could record, and whether the elevation model is one of another place; "" where there is nothing to say.
    """
    lacking = [_advice(log, cue) for cue in _ADVICE if cue in cues and cue not in cues_of(log)]
    elsewhere = _of_terrain(log, dem, ground) if ground is not None and not ground.share else []
    zeros = [NO_HEIGHTS] if NO_HEIGHTS in log.warnings else []
    return joined([*zeros, *lacking, *elsewhere])


def with_agreement(report: Mapping[str, Any], rejected: int, duplicate_of: str | None) -> list[str]:
    """The warnings of a drive that was solved with others: rejected on so many of its segments, another log's duplicate
    (None: of no other)."""
    warnings = with_contradiction(remarks_of(report), rejected, report["segments_in_network"])
    return warnings if duplicate_of is None else with_duplicate(warnings, duplicate_of)


def with_contradiction(warnings: Sequence[str], rejected: int, segments: int) -> list[str]:
    """The warnings with that of a drive that is rejected on ``rejected`` of its ``segments``, where these are many.

    What an earlier look said of the same goes.
    """
    others = [one for one in warnings if getattr(one, "key", "") != "drive.contradicts"]
    if rejected <= REJECTED_SHARE * segments:
        return others
    return [
        *others,
        say("drive.contradicts", n=rejected, segments=segments, share=rejected / segments),
    ]


def with_duplicate(warnings: Sequence[str], other: str) -> list[str]:
    """The warnings with that of a drive of which another log, named ``other``, exists."""
    return [
        *warnings,
        say("drive.duplicate", other=other),
    ]


def _matched_share(track: Track) -> float:
    return float(np.mean(track.segment >= 0)) if len(track) else 0.0


def _advice(log: DriveLog, cue: str) -> str:
    """How a log of this format can have a cue that it lacks."""
    known = FORMATS.get(log.source_format)  # none of several formats, joined
    advice: str = getattr(known, f"{cue}_advice") if known else _ADVICE[cue]
    return advice


def _rests_on_terrain(log: DriveLog, result: DriveResult, method: Method, ground: Ground | None) -> bool:
    """Whether slopes came out to which the drive's own sensors said nothing."""
    if not result.slopes or ground is None or not ground.share:
        return False
    used = result.report.get("sensors", cues_of(log))
    return not set(used) & set(method.cues)


def _lacking(log: DriveLog, method: Method, *, only: bool, computed: bool) -> list[str]:
    """What the log lacks that would have made its slopes surer; a barometer makes up for either."""
    cues = cues_of(log)
    sentences: list[str] = []
    if only and method.cues:
        sentences.append(say("drive.terrain_alone"))
    if "barometer" in cues & set(method.cues):
        return sentences
    if "altitude" in method.cues and "altitude" not in cues and not computed:
        key = "drive.no_altitudes" if "doppler" in cues else "drive.no_altitudes_less_sure"
        sentences.append(say(key, advice=_advice(log, "altitude")))
    if "doppler" in method.cues and "doppler" not in cues:
        sentences.append(say("drive.no_doppler", advice=_advice(log, "doppler")))
    return sentences


def _never_changing(log: DriveLog) -> list[str]:
    """Altitudes that stand for none, perhaps."""
    altitude = known_altitudes(log)
    if len(altitude) < FEWEST_ALIKE or np.ptp(altitude):
        return []
    return [say("drive.same_altitudes", altitude=altitude[0], advice=_advice(log, "altitude"))]


def _of_terrain(log: DriveLog, dem: Dem | None, ground: Ground | None) -> list[str]:
    """Where the elevation model does not cover the drive, and where the log's altitudes are not what it says."""
    if dem is None or ground is None:
        return []
    if ground.share < PART_COVERED:
        west, south, east, north = log.bounds_deg()
        place = say("place.box", south=south, north=north, west=west, east=east)
        there = say("drive.model_there", names=_named(dem), place=place)
        if not ground.share:
            return [joined([NO_GROUND, there])]
        return [
            say("drive.ground_in_part", percent=100 * ground.share, there=there),
            *_altitudes_off(log, dem, ground),
        ]
    return _altitudes_off(log, dem, ground)


def _named(dem: Dem) -> str:
    rest = len(dem.names) - MOST_NAMED
    return ", ".join(dem.names[:MOST_NAMED]) + (say("more", n=rest) if rest > 0 else "")


def _altitudes_off(log: DriveLog, dem: Dem, ground: Ground) -> list[str]:
    """Altitudes that lie a constant off the ground, and such as are in feet."""
    off = None if _never_changing(log) else off_ground(log, ground.row, ground.height_m)
    if off is None:
        return []
    if off.in_feet:
        return [say("drive.feet")]
    if not off.is_constant:
        return []  # where the model stands out from itself is said elsewhere
    side = "above" if off.off_m > 0 else "below"
    return [say("drive.altitudes_off", off_m=abs(off.off_m), side=side, datum=dem.datum)]


def _doubt(log: DriveLog, ground: Ground | None, *, computed: bool) -> dict[str, Any] | None:
    """Why the altitudes that the log states are doubtful; of ``computed`` positions none are stated."""
    if computed or _never_changing(log):
        return None
    return height_doubt(log, *((None, None) if ground is None else (ground.row, ground.height_m)))


def _below_sea(doubt: Mapping[str, Any] | None) -> list[str]:
    """Altitudes below the sea, where no elevation model knows better."""
    if doubt is None or doubt["above_sea_m"] is None:
        return []
    return [say("drive.below_sea", below_m=-doubt["above_sea_m"])]


def _nothing_came_out(result: DriveResult) -> list[str]:
    """Why nothing came out, where nothing did."""
    if result.slopes:
        return []
    track = result.track
    matched = np.mean(track.segment >= 0)
    spacing = float(np.median(np.diff(track.time_s))) if len(track) > 1 else 0.0
    return [say("drive.no_slope", share=matched, spacing_s=spacing)]
