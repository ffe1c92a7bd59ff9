"""The registry of operators' queries. A new one is an entry here, with a statement in a store."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime

from sqlalchemy.orm import Session

from app.core.telemetry import audit
from app.map import figures
from app.map.figures import growth
from app.network.widenings import device_classes
from app.ops.admin import store
from app.ops.admin.attention import FAILED_DAYS, attention
from app.ops.admin.store import Parameters, Read, Rows
from fusion.registry import Registry


@dataclass(frozen=True)
class AdminQuery:
    """A named query: what it tells, and what each of its columns is."""

    name: str
    title: str
    description: str
    columns: Mapping[str, str]
    now: Read | None = None
    """How it is read; None: a worker makes it every ten minutes while the map changes, since it takes a look at all of
    it."""

    @property
    def kept(self) -> bool:
        """Whether it is of the moment at which a worker made it."""
        return self.now is None

    def read(self, session: Session, parameters: Parameters) -> tuple[Rows, datetime | None]:
        """The rows, and of which moment they are; None: of this."""
        if self.now is not None:
            return self.now(session, parameters), None
        # Before a worker has made them the first time they are made for who asks.
        there = figures.kept(session, self.name)
        return (figures.make(session, self.name), None) if there is None else (there.rows, there.made_at)


QUERIES: Registry[AdminQuery] = Registry("query")


for _query in (
    AdminQuery(
        "attention",
        "What needs a person first",
        "What is wrong, or may soon be, the worst first; empty while all is well. Failures are those of drives that "
        f"were uploaded within {FAILED_DAYS} days.",
        {
            "kind": "What it is about",
            "severity": "`act`: it does not get better by itself; `look`: it may",
            "count": "How many",
            "oldest_s": "Seconds since the first of them",
            "what": "A sentence",
            "said": "The same by its key in the catalogues of messages, as JSON",
            "link": "Where it is listed, below this service's address",
        },
        lambda session, asked: attention(session, asked.free_bytes, asked.least_bytes),
    ),
    AdminQuery(
        "drives",
        "Drives by day and status",
        "How many drives were uploaded on each day, by what has become of them.",
        {
            "day": "Of the upload, UTC",
            "status": "At present",
            "drives": "How many",
            "km": "Length of all of them",
            "uploaded_bytes": "Size of their logs",
            "waiting": "Of those that failed: how many wait for roads, and are computed by themselves once these come",
        },
        store.drives_by_day,
    ),
    AdminQuery(
        "queue",
        "What waits and runs",
        "Depth of the queue and the longest wait, by what waits.",
        {"kind": "What", "jobs": "How many", "oldest_s": "Seconds since the first of them came, or began"},
        store.queue,
    ),
    AdminQuery(
        "failures",
        "Failures by reason",
        "Why drives failed that were uploaded within so many days, the commonest reason first.",
        {
            "kind": "Of failure; `versant drives reprocess --failure` takes it",
            "drives": "How many",
            "share": "Of all drives of these days, 0 to 1",
            "latest_reason": "What the latest of them was told",
            "latest_said": "The same by its key in the catalogues of messages, as JSON",
            "latest_at": "When that was uploaded",
            "latest_drive": "Its id",
            "waiting": "How many of them wait for roads, and are computed by themselves once these come",
        },
        store.failures,
    ),
    AdminQuery(
        "times",
        "Processing times by method",
        f"What the time of the latest {store.LATEST_DRIVES} drives that are done went into: medians, and what 95 % did "
        "not exceed, seconds.",
        {
            "method": "Estimator",
            "drives": "How many",
            "waited_p50_s": "In the queue",
            "waited_p95_s": "",
            "computed_p50_s": "By a worker",
            "computed_p95_s": "",
            "published_p50_s": "Until its cells were solved",
            "published_p95_s": "",
            "computed_p50_s_per_km": "Computing, for each kilometre driven",
        },
        store.times,
    ),
    AdminQuery(
        "throughput",
        "What ended when",
        f"Drives by when they ended, by the hour of up to {store.HOURLY_DAYS} days, else by the day. Medians are those "
        f"of the latest in each, {store.SAMPLED} in all.",
        {
            "at": "When the hour, or the day, began, UTC",
            "done": "How many were done",
            "failed": "How many failed",
            "km": "Length of those that were done",
            "waited_p50_s": "In the queue",
            "computed_p50_s": "By a worker",
            "published_p50_s": "Until its cells were solved",
            "waiting": "Of those that failed: how many wait for roads now",
        },
        store.throughput,
    ),
    AdminQuery(
        "growth",
        "Coverage by day",
        "How much of each class of roads was driven at the end of each day, of today: now. A day that is missing was "
        "as the one before it.",
        {
            "day": "UTC",
            "highway": "Class in OpenStreetMap",
            "driven_segments": "How many have a slope that a drive stands behind",
            "driven_km": "Their length",
        },
        lambda session, asked: growth(session, asked.days),
    ),
    AdminQuery(
        "coverage",
        "Coverage by region and road class",
        "How much of the roads was driven. A road of two regions counts in both.",
        {
            "region": "Name; empty: of none",
            "highway": "Class in OpenStreetMap",
            "segments": "How many there are",
            "network_km": "Their length",
            "driven_segments": "How many have a slope that a drive stands behind",
            "driven_km": "Their length",
        },
    ),
    AdminQuery(
        "sigmas",
        "Sigmas by number of drives",
        "How sure slopes are, by how many drives are behind them.",
        {
            "drives_from": "Drives: from so many to below twice as many",
            "sigma_from_percent": "Sigma of the slope: from so many percent to below the next step",
            "segments": "How many",
            "km": "Their length",
        },
    ),
    AdminQuery(
        "disagreements",
        "Worst disagreements between drives",
        "Segments on which drives are rejected because they contradict the others, the worst first: by how many are "
        "rejected, times how far off the farthest is. The cause is a parallel road, a changed road, or a bad mount.",
        {
            "segment_id": "Number; /v1/segments/{id}/observations tells which drive says what",
            "osm_way_id": "Way in OpenStreetMap",
            "highway": "Its class",
            "name": "Its name",
            "slope_percent": "Published",
            "slope_sigma_percent": "Its sigma",
            "drives": "Drives behind it",
            "drives_rejected": "Drives that are rejected there",
            "lowest_percent": "The least that any drive says",
            "highest_percent": "The most",
            "farthest_sigmas": "How far from the published slope the farthest is, in its own sigmas",
            "drives_unheard": "Deprecated: former name of drives_rejected",
        },
    ),
    AdminQuery(
        "terrain",
        "Elevation model against drives",
        "How far the elevation model's slopes are from measured ones, by tile of zoom 12, the worst first; open roads "
        "only, weighted by length.",
        {
            "tile": "z/x/y",
            "segments": "How many were compared",
            "km": "Their length",
            "mean_difference_percent": "Model less drives",
            "rms_difference_percent": "Root of the mean square",
            "rms_sigma_percent": "The same of the drives' own sigmas: what of it may be theirs",
        },
    ),
    AdminQuery(
        "repeats",
        "Repeats: what drives over one segment say of each other's sigmas",
        "Each drive's own slope of a segment against that of the drive before it, in sigmas that they state themselves "
        "(z, 1 in the root of the mean square where sigmas are true), by device class, direction, speed, length and "
        "season. Pairs of the same two drives share their errors: the band of z goes by pairs of drives.",
        {
            "kind": "What the group is of: `all`, `class`, `direction`, `speed`, `length` or `season`",
            "group": "Its name",
            "pairs": "Pairs of drives over one segment each",
            "drive_pairs": "Different pairs of drives among these",
            "segments": "Different segments",
            "rms_z": "Root of the mean square of z",
            "rms_z_sigma": "Its sigma",
            "inside_share": "Share of pairs within 1.96 sigmas; 0.95 where sigmas are true",
            "median_difference_percent": "Median of the difference of both slopes",
            "mean_sigma_percent": "Mean of the sigma that one drive states",
            "widening": "Of classes: what sigmas are multiplied by since their repeats contradicted them",
        },
    ),
    AdminQuery(
        "device-classes",
        "Widenings of device classes",
        "What repeats said of each class of devices when widenings were learned last, and what its drives' sigmas are "
        "multiplied by wherever the map is solved.",
        {
            "name": "Strongest sensor that was used, and the log's format",
            "applied": "What sigmas are multiplied by; 1: drives are taken at their word",
            "learned": "By how much repeats show them to be too small; below 1: too large",
            "sigma": "Of `learned`",
            "pairs": "Pairs of drives over one segment each, of this class on either side",
            "drive_pairs": "Different pairs of drives among these",
            "drives": "Drives of the class among these",
            "learned_at": "When",
            "marking": "Whether drives of it are still being marked for a change of `applied`",
        },
        lambda session, _asked: device_classes(session),
    ),
    AdminQuery(
        "tiles",
        "Kept vector tiles by zoom",
        "Compressed tiles in the database. A stale one shows what has changed since; it is built anew when it is asked "
        "for.",
        {
            "zoom": "Level",
            "tiles": "How many",
            "bytes": "Their size",
            "stale": "How many are older than the map",
        },
    ),
    AdminQuery(
        "versions",
        "Versions of everything",
        "What runs here, and on what.",
        {"what": "Of what", "version": "Which", "detail": "What is to be known of it"},
        store.versions,
    ),
    AdminQuery(
        "audit",
        "Who destroyed what",
        "Removals and bulk work that were asked for over HTTP within so many days, the newest first, at most "
        f"{audit.MOST_SHOWN}.",
        {
            "at": "When",
            "action": "What was asked for",
            "subject": "With what it was to be done",
            "detail": "What else was said, as JSON",
            "origin": "Address and program of whoever asked",
            "owner": "Whose key it was",
            "key": "Its id; empty where no key was shown",
        },
        lambda session, asked: audit.entries(session, asked.days),
    ),
    AdminQuery(
        "storage",
        "What takes room",
        "Logs in the blob store, then tables of the database with their indexes, the largest first.",
        {
            "kind": "`logs` or `table`",
            "name": "Of the table",
            "rows_about": "Rows, as the server last estimated them; of logs how many",
            "table_bytes": "With what is kept out of line; of logs as they were uploaded",
            "index_bytes": "Of its indexes",
        },
        store.storage,
    ),
):
    QUERIES.add(_query.name, _query)
