"""The logs of a service are written as an archive that a batch reads, owner by owner."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from app.access.store import create_owner
from app.batch.folder import BatchError
from app.batch.listing import list_logs
from app.batch.logs_out import LIST, Exported, export_logs
from app.cli import app
from app.core.db import Sessions
from app.drives.batches.importing import on_behalf_of
from app.drives.documents import Drive
from app.jobs.context import JobContext
from fusion.types import Progress, no_progress
from processing_support import accept_upload, remove_drive


class Unseen:
    """Nobody looks."""

    def work(self, name: str) -> Progress:
        return no_progress

    def count(self, name: str, total: int) -> Callable[[int], None]:
        return lambda more: None


def exported(context: JobContext, folder: Path, owner_id: int | None = None) -> Exported:
    return export_logs(context.sessions, context.blobs, folder, owner_id, Unseen())


def contents(folder: Path) -> dict[str, bytes]:
    """What a batch finds, by owner and name."""
    found = {}
    for log in list_logs([str(folder)]):
        path = Path(log.address)
        found[f"{path.parts[-3]}/{path.name}"] = path.read_bytes()
    return found


@pytest.fixture
def two(context: JobContext, files: Path) -> list[Drive]:
    """A drive of the operator and one of another owner."""
    with context.sessions.begin() as session:
        fleet = create_owner(session, "fleet / north")
    drives = [_uploaded(context, files / "0.csv", "monday.csv")]
    with on_behalf_of(context.sessions, fleet.id):
        drives.append(_uploaded(context, files / "1.csv", "../.monday.csv"))
    return drives


def _uploaded(context: JobContext, path: Path, name: str) -> Drive:
    one, _ = accept_upload(context.sessions, context.blobs, [path.read_bytes()], filename=name, method="raw")
    return one


def test_each_owner_has_a_folder(context: JobContext, two: list[Drive], files: Path, tmp_path: Path) -> None:
    folder = tmp_path / "logs"
    first = exported(context, folder)
    assert (first.logs, first.new, first.removed) == ({"operator": 1, "fleet / north": 1}, 2, 0)
    north = next(one for one in contents(folder) if one.endswith("north/monday.csv"))
    assert contents(folder) == {
        "1-operator/monday.csv": (files / "0.csv").read_bytes(),
        north: (files / "1.csv").read_bytes(),
    }
    told = [json.loads(line) for line in (folder / LIST).read_text().splitlines()]
    assert [(one["drive"], one["owner"]) for one in told] == [
        (str(two[0].id), "operator"),
        (str(two[1].id), "fleet / north"),
    ]


def test_the_same_folder_follows_the_service(
    context: JobContext, two: list[Drive], files: Path, tmp_path: Path
) -> None:
    """A cut leaves what is whole; a lost log is told, and what was removed goes."""
    folder = tmp_path / "logs"
    exported(context, folder)
    whole = contents(folder)
    next(folder.rglob("monday.csv")).write_bytes(b"half")
    (folder / LIST).write_text("")
    assert exported(context, folder).new == 1
    assert contents(folder) == whole

    assert remove_drive(context.sessions, context.blobs, two[0].id)
    context.blobs.delete(two[1].blob_key)
    third = _uploaded(context, files / "2.csv", "tuesday.csv")
    again = exported(context, folder)
    assert (again.new, again.removed, list(again.left_out)) == (1, 1, [str(two[1].id)])
    kept = [name for name in whole if name.endswith("north/monday.csv")]
    assert [*contents(folder)] == ["1-operator/tuesday.csv", *kept], "what the service has lost stays here"
    assert [path.name for path in (folder / "1-operator").iterdir()] == [str(third.id)]


def test_other_files_are_left_alone(context: JobContext, tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "letter.txt").write_text("mine")
    with pytest.raises(BatchError, match="holds other files"):
        exported(context, tmp_path / "mine")


def test_the_command(
    context: JobContext,
    two: list[Drive],
    sessions: Sessions,
    database_url: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("VERSANT_DATABASE_URL", database_url)
    monkeypatch.setenv("VERSANT_DATA_DIR", str(context.settings.data_dir))

    def invoke(*arguments: str | Path) -> Result:
        return CliRunner().invoke(app, ["export-logs", *map(str, arguments)])

    result = invoke(tmp_path / "logs", "--owner", "operator")
    assert result.exit_code == 0, result.output
    assert "1 logs of 1 owners, 1 of them new" in result.stdout
    context.blobs.delete(two[1].blob_key)
    result = invoke(tmp_path / "logs")
    assert result.exit_code == 1
    assert f"Drive {two[1].id}: Its log is not in the service" in result.stderr
