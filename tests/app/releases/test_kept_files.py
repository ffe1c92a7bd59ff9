"""A release has files: kept until the next one, the same when they are written again, and gone where none are made."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from app.cli import app
from app.core.blobs import EDITIONS, BlobStore
from app.releases.files import write_files
from app.releases.keeping import copy_files, folder_key
from app.releases.run import forget
from edition_support import edition_sessions
from fusion.types import no_progress
from release_support import LONG, Public, public

__all__ = ["public"]

NAMES = ["manifest.json", "slopes.gpkg", "slopes.parquet", "slopes.pmtiles"]


@pytest.fixture
def driven(public: Public, tmp_path: Path) -> Public:
    """Five owners drove along the whole street."""
    public.settings = public.settings.model_copy(update={"data_dir": tmp_path / "data"})
    for owner in range(5):
        public.drive(owner, range(LONG))
    return public


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


def test_files_of_a_release_are_the_same_when_they_are_written_again(driven: Public, tmp_path: Path) -> None:
    edition = driven.release()
    assert edition.segments > 0
    copy_files(driven.settings, edition, tmp_path / "kept")
    sessions = edition_sessions(driven.settings)
    write_files(sessions, tmp_path / "again", edition, driven.settings, no_progress)
    sessions.kw["bind"].dispose()
    kept = contents(tmp_path / "kept")
    assert [*kept] == NAMES
    assert kept == contents(tmp_path / "again")
    manifest = json.loads(kept["manifest.json"])
    assert {one.get("segments") for one in manifest["files"]} == {edition.segments, None}
    assert not (driven.settings.data_dir / "releases").exists()


def test_they_stay_until_the_next_release(driven: Public) -> None:
    blobs = BlobStore(driven.settings.blob_store_url, EDITIONS)
    first, second = driven.release(), driven.release()
    assert folder_key(first) != folder_key(second)
    assert blobs.keys() == [folder_key(second)]
    assert forget(driven.sessions, driven.settings)
    assert blobs.keys() == []


def test_the_command_writes_them_to_a_folder(
    driven: Public, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("VERSANT_DATABASE_URL", str(driven.settings.database_url))
    monkeypatch.setenv("VERSANT_DATA_DIR", str(driven.settings.data_dir))
    out = tmp_path / "public" / "slopes"
    done = CliRunner().invoke(app, ["release", "--day", "2026-11-20", "--output", str(out)])
    assert done.exit_code == 0, done.output
    assert sorted(path.name for path in out.iterdir()) == NAMES
    assert json.loads((out / "manifest.json").read_text(encoding="utf-8"))["day"] == "2026-11-20"
