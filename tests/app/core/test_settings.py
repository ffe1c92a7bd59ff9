"""Settings: defaults, environment, and sentences for values that cannot be used."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from app.core.settings import Settings, SettingsError, get_settings, load_settings
from app.core.settings.places import default_data_dir, libpq_url, sqlalchemy_url


@pytest.fixture(autouse=True)
def bare_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in Settings.model_fields:
        monkeypatch.delenv(f"VERSANT_{name.upper()}", raising=False)


def test_every_setting_has_a_default_and_a_sentence() -> None:
    assert Settings().port == 8000
    for name, field in Settings.model_fields.items():
        assert not field.is_required(), name
        assert field.description is not None, name
        assert field.description.endswith("."), name


def test_backgrounds_have_names(monkeypatch: pytest.MonkeyPatch) -> None:
    assert Settings().backgrounds == {}
    given = "Plain = https://map.example/s.json?a=1, Nacht=http://[::1]:8080/style"
    assert Settings(map_backgrounds=given).backgrounds == {
        "Plain": "https://map.example/s.json?a=1",
        "Nacht": "http://[::1]:8080/style",
    }
    for wrong in (
        "https://map.example/s.json",
        "=https://map.example/s",
        "Plain=map.example",
        "A=https://host",
    ):
        monkeypatch.setenv("VERSANT_MAP_BACKGROUNDS", wrong)
        with pytest.raises(SettingsError, match="Plain=https"):
            load_settings()


def test_only_this_machine_is_served_by_default() -> None:
    assert Settings().host == "127.0.0.1"


def test_data_dir_follows_xdg(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    assert Settings().data_dir == tmp_path / "versant"
    assert Settings().blob_store_url == (tmp_path / "versant" / "blobs").as_uri()
    assert Settings().dem_dir.parent == tmp_path / "versant"


@pytest.mark.parametrize("value", ["", "relative/folder"])
def test_data_dir_without_a_usable_xdg(value: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_DATA_HOME", value)
    assert default_data_dir() == Path.home() / ".local" / "share" / "versant"


def test_relative_data_dir_is_fixed_where_it_was_given(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    settings = Settings(data_dir=Path("here"))
    monkeypatch.chdir("/")
    assert settings.data_dir == tmp_path / "here"


def test_environment_is_read_and_empty_means_unset(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("VERSANT_PORT", "8123")
    monkeypatch.setenv("VERSANT_BLOB_URL", "")
    settings = load_settings()
    assert (settings.port, settings.blob_url) == (8123, None)


def test_get_settings_reads_once(monkeypatch: pytest.MonkeyPatch) -> None:
    get_settings.cache_clear()
    monkeypatch.setenv("VERSANT_PORT", "8001")
    first = get_settings()
    monkeypatch.setenv("VERSANT_PORT", "8002")
    assert get_settings() is first
    get_settings.cache_clear()
    assert get_settings().port == 8002
    get_settings.cache_clear()


@pytest.mark.parametrize(
    ("variable", "value"),
    [
        ("VERSANT_PORT", "many"),
        ("VERSANT_PORT", "65536"),
        ("VERSANT_MAX_UPLOAD_BYTES", "0"),
        ("VERSANT_DATABASE_URL", "mysql://somebody:hunter2@host/versant"),
        ("VERSANT_DATABASE_URL", "versant"),
        ("VERSANT_PUBLIC_URL", "slopes.example"),
        ("VERSANT_LOG_LEVEL", "LOUD"),
    ],
)
def test_bad_value_names_the_variable_but_not_the_value(
    variable: str, value: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(variable, value)
    with pytest.raises(SettingsError, match=variable) as caught:
        load_settings()
    assert "hunter2" not in str(caught.value)


@pytest.mark.parametrize(
    ("variable", "value", "sentence"),
    [
        ("VERSANT_HEARTBEAT_INTERVAL_S", "29", "at least twice"),
        ("VERSANT_ITEMS_LIMIT_MAX", "3", "items_limit_default"),
        ("VERSANT_TILE_FULL_ZOOM", "2", "zoom levels"),
    ],
)
def test_settings_that_contradict_each_other(
    variable: str, value: str, sentence: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(variable, value)
    with pytest.raises(SettingsError, match=sentence):
        load_settings()


@pytest.mark.parametrize("scheme", ["postgres", "postgresql", "postgresql+psycopg"])
def test_database_url_forms(scheme: str) -> None:
    url = f"{scheme}://me:p%40ss@db:5432/versant?sslmode=require"
    assert sqlalchemy_url(url) == "postgresql+psycopg://me:p%40ss@db:5432/versant?sslmode=require"
    assert libpq_url(url) == "postgresql://me:p%40ss@db:5432/versant?sslmode=require"
    assert Settings(database_url=url).database_url == sqlalchemy_url(url)


def test_repr_hides_the_database_password() -> None:
    assert "hunter2" not in repr(Settings(database_url="postgresql://me:hunter2@db/versant"))


def test_nothing_is_read_at_import() -> None:
    code = "import app.core.settings; print('read')"
    done = subprocess.run(
        [sys.executable, "-c", code],
        env={"VERSANT_PORT": "nonsense", "PYTHONPATH": str(Path(__file__).parents[3])},
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.stdout.strip(), done.returncode) == ("read", 0), done.stderr


@pytest.mark.parametrize("url", ["/login", "https://login.example/start?app=versant"])
def test_a_login_may_be_here_or_elsewhere(url: str) -> None:
    assert Settings(login_url=url).login_url == url


@pytest.mark.parametrize(
    "url", ["//elsewhere.example", "/\\elsewhere.example", "javascript:alert(1)", "login"]
)
def test_a_login_is_a_path_or_an_address(monkeypatch: pytest.MonkeyPatch, url: str) -> None:
    monkeypatch.setenv("VERSANT_LOGIN_URL", url)
    with pytest.raises(SettingsError, match="VERSANT_LOGIN_URL: it must begin with"):
        load_settings()
