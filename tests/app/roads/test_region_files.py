"""Files of changes, applied to what is kept of a region's file."""

from __future__ import annotations

import gzip
from pathlib import Path

import pytest
from sqlalchemy import text

from app.core.db import Sessions
from app.core.settings.places import RemoteFolder
from app.roads import store
from app.roads.documents import ImportCounts, Wishes
from app.roads.imports import import_roads, remove_region
from fusion.errors import RoadsError
from region_support import stored

TOWN = """<?xml version="1.0"?><osm version="0.6">
<way id="10" version="1"><nd ref="1"/><nd ref="2"/><tag k="highway" v="residential"/></way>
<way id="11" version="1"><nd ref="2"/><nd ref="3"/><tag k="building" v="yes"/></way>
<way id="12" version="1"><nd ref="2"/><nd ref="4"/><tag k="highway" v="path"/></way>
<way id="13" version="1"><nd ref="4"/><nd ref="5"/><tag k="highway" v="residential"/></way>
<node id="1" version="1" lat="49" lon="8"/><node id="2" version="1" lat="49.001" lon="8"/>
<node id="3" version="1" lat="49.002" lon="8"/><node id="4" version="1" lat="49.003" lon="8"/>
<node id="5" version="1" lat="49.004" lon="8.001"/>
</osm>"""
CHANGES = """<?xml version="1.0"?><osmChange version="0.6">
<modify><node id="1" version="2" lat="49.00001" lon="8"/>
<way id="12" version="2"><nd ref="2"/><nd ref="4"/><nd ref="99"/><tag k="highway" v="service"/></way></modify>
<create><node id="50" version="1" lat="55" lon="8"/><node id="51" version="1" lat="55.1" lon="8"/>
<node id="52" version="1" lat="49.0005" lon="8.0005"/>
<way id="20" version="1"><nd ref="50"/><nd ref="51"/><tag k="highway" v="residential"/></way>
<way id="21" version="1"><nd ref="1"/><nd ref="52"/><tag k="highway" v="residential"/></way></create>
<delete><way id="13" version="2"/></delete>
</osmChange>"""
AFTER = ImportCounts(
    "town", moved=1, dropped=1, added=2, skipped={"node missing from the file": 1}
)  # the path is a road now, the way far away is not taken


def town(folder: Path) -> Path:
    file = folder / "town.osm"
    file.write_text(TOWN)
    return file


@pytest.mark.parametrize("packed", [False, True])
def test_changes_are_applied_to_what_the_region_had(sessions: Sessions, tmp_path: Path, packed: bool) -> None:
    place = tmp_path / "kept"
    assert import_roads(sessions, town(tmp_path), place).added == 2
    changes = tmp_path / ("monday.osc.gz" if packed else "monday")
    changes.write_bytes(gzip.compress(CHANGES.encode()) if packed else CHANGES.encode())
    (before,) = place.rglob("*.osm.pbf")
    trial = import_roads(sessions, changes, place, wishes=Wishes(dry_run=True))
    assert list(place.rglob("*.osm.pbf")) == [before]
    assert import_roads(sessions, changes, place) == AFTER
    assert (trial.moved, trial.dropped, trial.added) == (1, 1, 2)
    assert set(stored(sessions)) == {(10, 1, 2), (12, 2, 4), (21, 1, 52)}
    (after,) = place.rglob("*.osm.pbf")  # that of before is gone
    assert after != before
    again = import_roads(sessions, changes, place, region="town")
    assert (again.kept, again.added, again.dropped) == (3, 0, 0)
    remove_region(sessions, "town", place)
    assert list(place.rglob("*.osm.pbf")) == []


def test_what_is_kept_is_found_from_another_machine(sessions: Sessions, tmp_path: Path) -> None:
    there = [RemoteFolder(f"file://{tmp_path}/bucket", tmp_path / name) for name in ("one", "two")]
    import_roads(sessions, town(tmp_path), there[0])
    changes = tmp_path / "town.osc"
    changes.write_text(CHANGES)
    assert import_roads(sessions, changes, there[1]) == AFTER
    assert len(list((tmp_path / "bucket").rglob("*.osm.pbf"))) == 1


def test_changes_that_cannot_be_applied_are_refused(sessions: Sessions, tmp_path: Path) -> None:
    changes = tmp_path / "monday.osc"
    changes.write_text(CHANGES)
    place = tmp_path / "kept"
    with pytest.raises(RoadsError, match="not clear of which region"):
        import_roads(sessions, changes, place)
    import_roads(sessions, town(tmp_path), place)
    with pytest.raises(RoadsError, match=r"There is no region 'vienna'\. There are: town\."):
        import_roads(sessions, changes, place, region="vienna")
    changes.write_text("<osmChange><create><node")
    with pytest.raises(RoadsError, match=r"monday\.osc is damaged"):
        import_roads(sessions, changes, place)
    changes.write_text(CHANGES)
    (kept,) = place.rglob("*.osm.pbf")
    kept.unlink()
    with pytest.raises(RoadsError, match="is lost"):
        import_roads(sessions, changes, place)
    with sessions.begin() as session:
        session.execute(text("UPDATE regions SET file_uri = NULL"))
    with pytest.raises(RoadsError, match="Import its whole file once"):
        import_roads(sessions, changes, place)
    import_roads(sessions, town(tmp_path), place, region="second")
    with sessions() as session:
        assert store.changed_region(session, None, "town.osc.gz").name == "town"
    with pytest.raises(RoadsError, match=r"\(second, town\)"):
        import_roads(sessions, changes, place)
