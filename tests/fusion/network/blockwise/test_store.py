"""What work leaves for later work is what it was."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from fusion.network.blockwise.store import FolderStore, MemoryStore, Store


def test_stores_give_what_they_were_given_last(tmp_path: Path) -> None:
    stores: list[Store] = [MemoryStore(), FolderStore(tmp_path)]
    for store in stores:
        for value in (np.arange(3.0), np.linspace(0, 1, 5)):
            store.put(("told", 1), value)
            store.put(("told", 2), -value)
            assert store.get(("told", 1)).tobytes() == value.tobytes()
            assert store.get(("told", 2)).tobytes() == (-value).tobytes()


def test_what_a_folder_gives_may_be_changed(tmp_path: Path) -> None:
    store = FolderStore(tmp_path)
    store.put(("factor", 0), np.zeros(3))
    store.get(("factor", 0))[:] = 1
    assert store.get(("factor", 0)).tolist() == [0, 0, 0]
