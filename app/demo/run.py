"""From nothing to slopes: every step that a person would take, through the same doors.

Beside them what one has without Versant, and one thing that nobody has: the true heights of a structure's ends.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from app.access.folder import read_key
from app.cli.client import Client, RemoteDrive, shown
from app.cli.console import Bars, Console
from app.cli.database import sessions_of
from app.cli.keys.starting import see_to_key
from app.cli.logs.fusing import Fusion
from app.cli.supervisor import Service
from app.core import migrate
from app.core.messages import say
from app.core.settings import Settings
from app.demo.score import Estimate, Score, SegmentKey, Truth, by_kind, by_structure, score
from app.embedded.cluster import EmbeddedPostgres
from app.roads import imports as road_imports
from app.terrain import imports as dem_imports
from fusion.errors import FusionError
from fusion.pipeline import parse_options
from fusion.simulate.demonstration import Demonstration, write_all
from fusion.simulate.scene.town import Town
from fusion.simulate.write.csv_file import LEAST_DRIVEN_M
from fusion.terrain.dem import Dem

DRIVES, SEED, DURATION_S = 6, 1, 600.0
"""What is simulated; as ``versant simulate`` does by default."""
DRIVE_TIMEOUT_S = 600.0
"""After which a drive that is not done makes the demonstration fail."""


class DemoError(FusionError):
    """The demonstration did not work out."""

    kind = "demo"


@dataclass
class DemoResult:
    """What the service answered, beside the truth and the baselines."""

    bundle: Demonstration
    drives: list[RemoteDrive]
    features: list[dict[str, Any]]
    truth: dict[SegmentKey, Truth]
    baselines: dict[str, dict[SegmentKey, Estimate]]
    profile_png: bytes
    seconds: dict[str, float] = field(default_factory=dict)

    @property
    def properties(self) -> dict[SegmentKey, dict[str, Any]]:
        """What the service says of each segment."""
        return {feature_key(feature): feature["properties"] for feature in self.features}

    @property
    def estimates(self) -> dict[SegmentKey, Estimate]:
        """The service's slopes."""
        return {
            key: Estimate(of["slope_percent"], of["slope_sigma_percent"])
            for key, of in self.properties.items()
            if of["slope_percent"] is not None
        }

    def scores(self) -> dict[str, Score]:
        """The service's score, then each baseline's that is for all roads."""
        return {name: score(self.truth, e) for name, e in self._compared.items() if name != "straight"}

    def scores_by_kind(self) -> dict[str, Score]:
        """The service's score by class of road."""
        return by_kind(self.truth, self.estimates)

    def scores_by_structure(self) -> dict[str, dict[str, Score]]:
        """For the open road, bridges and tunnels: the service's score, then each baseline's."""
        scored = {name: by_structure(self.truth, e) for name, e in self._compared.items()}
        return {kind: {name: of[kind] for name, of in scored.items()} for kind in scored["service"]}

    @property
    def _compared(self) -> dict[str, dict[SegmentKey, Estimate]]:
        return {"service": self.estimates, **self.baselines}


@contextmanager
def demo_service(console: Console, port: int = 0) -> Iterator[Service]:
    """API and worker on a database in a folder of its own, which is removed at the end."""
    # Not durable: nobody misses this database after a power cut, and it starts in half the time.
    with (
        tempfile.TemporaryDirectory(prefix="versant-demo-") as folder,
        EmbeddedPostgres(Path(folder), durable=False) as cluster,
    ):
        migrate.upgrade(cluster.url)
        settings = Settings(
            database_url=cluster.url, data_dir=Path(folder), port=port, host="127.0.0.1", log_level="WARNING"
        )
        see_to_key(settings)
        with Service(settings, console, cluster=cluster) as service:
            yield service


def run_demo(
    service: Service,
    folder: Path,
    bars: Bars,
    *,
    drives: int = DRIVES,
    seed: int = SEED,
    duration_s: float = DURATION_S,
    options: Mapping[str, Any] | None = None,
) -> DemoResult:
    """Simulate into ``folder``, import, upload, wait, read back, and compute the baselines.

    ``options`` are those of the default method; without them the demonstration shows its defaults.
    Raises ``DemoError`` when a drive does not end as ``done``.
    """
    seconds: dict[str, float] = {}
    with _timed("simulate", seconds):
        bundle = write_all(folder, drives, seed, duration_s=duration_s, progress=bars.work("simulating"))
    with _timed("import", seconds):
        _import(service.settings, bundle, bars)
    with Client(service.address, key=read_key(service.settings.data_dir)) as client:
        with _timed("fuse", seconds):
            done = _upload(client, bundle.drives, options or {}, bars)
        features = list(client.features("/collections/segments/items", limit=1000))
        shown_drive = done[_drive_to_show(bundle)]
        profile = client.get(f"/v1/drives/{shown_drive.id}/profile", accept="image/png").content
    with _timed("baselines", seconds):
        beside = baselines(bundle, features, bars)
    return DemoResult(bundle, done, features, driven_truth(bundle), beside, profile, seconds)


def driven_truth(bundle: Demonstration) -> dict[SegmentKey, Truth]:
    """The true slopes of the segments that some drive covered over at least 10 m."""
    town = bundle.town
    roads = town.roads
    passes = [p for drive in bundle.simulated for p in drive.passes() if p.driven_m >= LEAST_DRIVEN_M]
    return {
        (int(roads.osm_way_id[k]), int(roads.from_node[k]), int(roads.to_node[k])): Truth(
            float(town.true_slope_percent[k]),
            str(roads.highway[k]),
            bool(roads.bridge[k]),
            bool(roads.tunnel[k]),
        )
        for k in sorted({p.segment for p in passes})
    }


def _drive_to_show(bundle: Demonstration) -> int:
    """Number of the drive through most of the tunnels and bridges: there its profile shows most."""
    roads = bundle.town.roads
    driven = [np.unique([p.segment for p in drive.passes()]) for drive in bundle.simulated]
    return int(np.argmax([roads.tunnel[k].sum() * len(roads) + roads.bridge[k].sum() for k in driven]))


def _import(settings: Settings, bundle: Demonstration, bars: Bars) -> None:
    with sessions_of(settings) as sessions:
        road_imports.import_roads(sessions, bundle.osm, settings.dem_dir, bars.work(bundle.osm.name))
        dem_imports.import_dem(sessions, [bundle.dem], settings.dem_dir, bars.work(bundle.dem.name))


def _upload(
    client: Client, paths: Sequence[Path], options: Mapping[str, Any], bars: Bars
) -> list[RemoteDrive]:
    sent = [
        client.upload(
            p, options=options, sent=bars.count(say("stage.sending", name=p.name), p.stat().st_size)
        )
        for p in paths
    ]
    done = []
    for path, drive in zip(paths, sent, strict=True):
        show = bars.work(say("stage.fusing", name=path.name))
        final = client.wait(drive.id, seen=shown(show), timeout_s=DRIVE_TIMEOUT_S)
        if final.status != "done":
            raise DemoError(say("demo.ended", name=path.name, status=final.status, reason=final.reason))
        done.append(final)
    return done


@contextmanager
def _timed(stage: str, seconds: dict[str, float]) -> Iterator[None]:
    started = time.perf_counter()
    yield
    seconds[stage] = round(time.perf_counter() - started, 2)


def feature_key(feature: Mapping[str, Any]) -> SegmentKey:
    """The identity of a segment."""
    properties = feature["properties"]
    return int(properties["osm_way_id"]), int(properties["from_node"]), int(properties["to_node"])


def baselines(
    bundle: Demonstration, features: Sequence[Mapping[str, Any]], bars: Bars
) -> dict[str, dict[SegmentKey, Estimate]]:
    """A line through the raw altitudes, the DEM's heights at a segment's ends, and ``straight_lines``."""
    terrain = {
        feature_key(f): Estimate(f["properties"]["dem_slope_percent"], float("nan"))
        for f in features
        if f["properties"]["dem_slope_percent"] is not None
    }
    return {"raw": _raw(bundle, bars), "dem": terrain, "straight": straight_lines(bundle.town)}


def straight_lines(town: Town) -> dict[SegmentKey, Estimate]:
    """Every segment of a bridge or tunnel: the straight line between the road's true heights at the structure's ends.

    A structure is a way (``town`` cuts ways where their kind changes). Real elevation models know these heights to
    metres at best, so that this is the best that guessing can do.
    """
    roads, lines = town.roads, {}
    structure = roads.bridge | roads.tunnel
    for way in np.unique(roads.osm_way_id[structure]):
        of_way = np.flatnonzero(roads.osm_way_id == way)
        # Segments are drawn the same way round: one end is nobody's to_node, the other nobody's from_node.
        (first,) = set(town.start[of_way].tolist()) - set(town.end[of_way].tolist())
        (last,) = set(town.end[of_way].tolist()) - set(town.start[of_way].tolist())
        rise = town.node_height_m[last] - town.node_height_m[first]
        slope = 100 * float(rise / town.length_m[of_way].sum())
        for k in of_way.tolist():
            key = int(roads.osm_way_id[k]), int(roads.from_node[k]), int(roads.to_node[k])
            lines[key] = Estimate(slope, float("nan"))
    return lines


def _raw(bundle: Demonstration, bars: Bars) -> dict[SegmentKey, Estimate]:
    with Dem.open([bundle.dem]) as dem:
        raw = Fusion("raw", parse_options("raw"), bundle.town.roads, dem)
        show = bars.work("baseline raw")
        for k, path in enumerate(bundle.drives):
            show(path.name, k / len(bundle.drives))
            raw.add(path)
        slopes = raw.features()
    return {
        (s.osm_way_id, s.from_node, s.to_node): Estimate(
            _number(s.slope_percent), _number(s.slope_sigma_percent)
        )
        for s in slopes
    }


def _number(value: float | None) -> float:
    return float(np.nan) if value is None else value
