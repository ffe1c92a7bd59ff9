"""A made-up country: as large as asked for, in one piece, and its passes are read as they were made."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest

from country.made import Country, PassFiles, make_drives
from fusion.network.blockwise.partition import bisected
from fusion.network.subnetwork import joined_parts
from network_draws import driven_town, town


@pytest.mark.parametrize("segments", [50, 97, 350, 600])
def test_a_country_hangs_together(segments: int) -> None:
    made = Country.of(town(8, 7), segments)
    sizes = np.bincount(made.town[made.town >= 0])
    assert sizes.sum() == segments
    assert np.all(sizes[:-1] == 97)
    _, node = np.unique(np.concatenate([made.roads.from_node, made.roads.to_node]), return_inverse=True)
    start, end = np.split(node, 2)
    assert len(np.unique(joined_parts(int(node.max()) + 1, start, end))) == 1
    between = made.roads.length_m[made.town < 0]
    assert np.all((between > 40) & (between < 80))


def test_passes_are_read_as_they_were_made(tmp_path: Path) -> None:
    table, drives = driven_town()
    block = bisected(table, 20).block
    files = PassFiles(tmp_path)
    files.put({d: drives[d] for d in (0, 1, 2)}, block, 0)
    files.put({d: drives[d] for d in (3, 4, 5)}, block, 1)
    read = [
        (d, p) for k in np.unique(block).tolist() for d, passes in files.passes(k).items() for p in passes
    ]
    assert all(block[p.segment] == k for k in np.unique(block) for ps in files.passes(k).values() for p in ps)
    found = {(d, p.sequence): p.vector.tobytes() for d, p in read}
    assert found == {(d, p.sequence): p.vector.tobytes() for d, ps in drives.items() for p in ps}


def test_drives_begin_in_their_town_or_join_all_of_them(tmp_path: Path) -> None:
    made = Country.of(town(8, 7), 350)
    block, files, file = bisected(made.roads, 60).block, PassFiles(tmp_path), tmp_path / "country"
    file.write_bytes(pickle.dumps((made, block)))
    assert make_drives(files, file, 1, 2) > 0
    local = {
        made.town[p.segment] for k in np.unique(block).tolist() for d in files.passes(k).values() for p in d
    }
    assert 1 in local
    make_drives(files, file, -1, 0)
    towns: dict[int, set[int]] = {}
    for k in np.unique(block).tolist():
        for name, passes in files.passes(k).items():
            towns.setdefault(name, set()).update(made.town[[p.segment for p in passes]].tolist())
    assert sorted(len(t) for name, t in towns.items() if name < 1_000_000)[-1] == 5
