"""Folders that cannot be the cluster's are left alone, and the person is told why."""

from __future__ import annotations

from pathlib import Path

import pytest

from app.embedded.cluster import EmbeddedPostgres
from app.embedded.errors import EmbeddedPostgresError


@pytest.mark.parametrize("below", ["", "a/b"])
def test_a_plain_file_is_no_data_folder(below: str, tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.write_text("kept")
    with pytest.raises(EmbeddedPostgresError, match=f"{file} is not a folder"):
        EmbeddedPostgres(file / below).start()
    assert file.read_text() == "kept"


def test_a_folder_that_cannot_be_made_is_explained(tmp_path: Path) -> None:
    long = tmp_path / ("x" * 300)
    with pytest.raises(EmbeddedPostgresError, match=r"xxx.* cannot be used for the database"):
        EmbeddedPostgres(long).start()


def test_a_folder_with_something_else_in_it_is_left_alone(tmp_path: Path) -> None:
    data = tmp_path / "postgres" / "data"
    data.mkdir(parents=True)
    (data / "thesis.tex").write_text("precious")
    with pytest.raises(EmbeddedPostgresError, match="no PostgreSQL cluster"):
        EmbeddedPostgres(tmp_path).start()
    assert (data / "thesis.tex").read_text() == "precious"


def test_a_damaged_cluster_is_explained(tmp_path: Path) -> None:
    data = tmp_path / "postgres" / "data"
    data.mkdir(parents=True)
    (data / "PG_VERSION").write_text("")
    with pytest.raises(EmbeddedPostgresError, match="damaged"):
        EmbeddedPostgres(tmp_path).start()
