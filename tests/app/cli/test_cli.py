"""What every command has in common: status, one line of complaint, flags, help."""

from __future__ import annotations

import importlib
import json
from pathlib import Path
from typing import Any

import pytest
import typer
from typer.testing import CliRunner

from app.cli import COMMANDS, app
from app.cli.console import Console, figure, sentence, write_json
from app.cli.options import parse_assignments, parse_box
from fusion.errors import FusionError

runner = CliRunner()


def test_commands_are_those_of_the_design() -> None:
    served = "demo up api worker migrate import-roads regions import-dem import-control upload drives settle release "
    served += "repeats elevation keys backup restore doctor sweep"
    alone = "fuse batch import-batch export-logs track gnss-study score simulate export hpms methods"
    assert list(COMMANDS) == f"{served} {alone}".split()


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_explains_itself(name: str) -> None:
    result = runner.invoke(app, [name, "--help"], env={"COLUMNS": "200"})
    assert result.exit_code == 0
    assert name in result.stdout
    assert "Usage" in result.stdout


def test_version() -> None:
    result = runner.invoke(app, ["--version"])
    assert result.exit_code == 0
    assert result.stdout.startswith("versant ")


@pytest.mark.parametrize(
    "arguments",
    [
        ["nonsense"],
        ["fuse"],
        ["fuse", "a.csv"],
        ["fuse", "a.csv", "--roads", "r.osm", "--method", "nonsense"],
        ["fuse", "a.csv", "--roads", "r.osm", "--option", "particles"],
        ["fuse", "a.csv", "--roads", "r.osm", "--option", "particles=-1"],
        ["fuse", "a.csv", "--roads", "r.osm", "-o", "out.xyz"],
        ["track", "a.csv", "-o", "out.xyz"],
        ["track", "a.csv", "-o", "out.csv", "--gnss", "nonsense"],
        ["export", "-o", "out.xyz"],
        ["export", "-o", "out.csv", "--bbox", "8,49,7,50"],
        ["simulate", "-o", "x", "--receiver", "nonsense"],
        ["up", "--port", "99999"],
        ["fuse", "a.csv", "--roads", "r.osm", "-o", "none/out.csv"],
        ["fuse", "a.csv", "--roads", "r.osm", "--profile", "none/out.png"],
        ["fuse", "a.csv", "--roads", "r.osm", "--track", "none/out.geojson"],
        ["track", "a.csv", "-o", "none/out.csv"],
        ["track", "a.csv", "-o", "out.csv", "--columns", "alt_msl_m"],
        ["track", "a.csv", "-o", "out.csv", "--columns", "altitude=Hoehe"],
        ["fuse", "a.csv", "--roads", "b.osm", "--columns", "altitude=Hoehe"],
        ["upload", "a.csv", "--columns", "altitude=Hoehe"],
        ["export", "-o", "none/out.csv"],
    ],
    ids=" ".join,
)
def test_wrong_usage_is_status_2(
    arguments: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    result = runner.invoke(app, arguments)
    assert result.exit_code == 2
    assert "Traceback" not in result.stderr
    assert not result.stdout
    assert not list(tmp_path.iterdir())


def test_the_folder_that_is_missing_is_named(tmp_path: Path) -> None:
    out = tmp_path / "none" / "out.csv"
    result = runner.invoke(app, ["export", "-o", str(out)], env={"COLUMNS": "1000"})
    assert f"there is no folder {out.parent}." in result.stderr
    assert "partial" not in result.stderr


@pytest.mark.parametrize("command", ["up", "migrate", "export -o x.csv", "api", "worker"])
def test_a_data_dir_that_is_a_file_is_wrong_usage(command: str, tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.touch()
    result = runner.invoke(app, [*command.split(), "--data-dir", str(file)], env={"COLUMNS": "1000"})
    assert result.exit_code == 2
    assert "--data-dir" in result.stderr
    assert f"{file}' is a file" in result.stderr


@pytest.mark.parametrize("command", ["api", "worker"])
@pytest.mark.parametrize("host", ["127.0.0.1", "localhost"])
def test_api_and_worker_say_that_the_database_is_not_there(
    command: str, host: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("VERSANT_DATABASE_URL", f"postgresql://somebody:secret@{host}:9/roads")
    monkeypatch.setenv("VERSANT_DATA_DIR", str(tmp_path))
    result = runner.invoke(app, [command])
    assert result.exit_code == 1
    (line,) = result.stderr.splitlines()
    assert line.startswith(f"versant: The database at {host}:9/roads cannot be reached: ")
    assert "refused" in line
    assert "VERSANT_DATABASE_URL" in line
    assert "secret" not in line


def test_a_password_with_an_at_sign_is_not_printed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("VERSANT_DATABASE_URL", "postgresql://somebody:half@secret@127.0.0.1:9/roads")
    result = runner.invoke(app, ["worker"])
    assert result.exit_code == 1
    assert "%40" in result.stderr
    assert "secret" not in result.stderr


def test_failure_is_status_1_and_one_line(tmp_path: Path) -> None:
    missing = tmp_path / "none.osm"
    result = runner.invoke(app, ["fuse", "a.csv", "--roads", str(missing)])
    assert result.exit_code == 1
    assert not result.stdout
    (line,) = result.stderr.splitlines()
    assert line.startswith("versant: ")
    assert "none.osm" in line


def test_debug_shows_where(tmp_path: Path) -> None:
    arguments = ["fuse", "a.csv", "--roads", str(tmp_path / "none.osm"), "--debug"]
    result = runner.invoke(app, arguments)
    assert isinstance(result.exception, FusionError)


def test_settings_at_fault_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("VERSANT_PORT", "many")
    result = runner.invoke(app, ["migrate"])
    assert result.exit_code == 1
    assert "VERSANT_PORT" in result.stderr


def test_database_that_is_not_there_is_said_in_one_line(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("VERSANT_DATABASE_URL", f"postgresql://nobody@/none?host={tmp_path}")
    result = runner.invoke(app, ["export", "-o", str(tmp_path / "out.csv")])
    assert result.exit_code == 1
    (line,) = result.stderr.splitlines()
    assert line.startswith("versant: The database cannot be used")
    assert not (tmp_path / "out.csv").exists()


def test_global_flags_may_stand_anywhere_but_after_a_double_dash(tmp_path: Path) -> None:
    quiet = runner.invoke(app, ["simulate", "--quiet", "-o", str(tmp_path), "--drives", "0"])
    assert quiet.exit_code == 0
    literal = runner.invoke(app, ["fuse", "--roads", str(tmp_path / "town.osm"), "--", "--quiet"])
    assert literal.exit_code == 1
    assert "--quiet" in literal.stderr


def test_modules_hold_the_commands_they_are_said_to() -> None:
    for name, command in COMMANDS.items():
        group = importlib.import_module(command.module).app
        assert name in [found.name for found in (*group.registered_commands, *group.registered_groups)]


def test_the_help_s_sentences_are_those_of_the_commands() -> None:
    group: Any = typer.main.get_command(app)
    for name, command in COMMANDS.items():
        first = group.commands[name].help.split("\n\n")[0]
        assert command.summary == first.replace("\n", " ")


def test_sentence_needs_no_traceback() -> None:
    assert sentence(FusionError("Line 3 is\nempty.")) == "Line 3 is empty."
    assert sentence(FileNotFoundError(2, "No such file", "x.csv")) == "x.csv: No such file."
    assert "--debug" in sentence(ZeroDivisionError("division by zero"))


def test_tables_show_the_unknown_as_a_dash(capsys: pytest.CaptureFixture[str]) -> None:
    Console().table(["a", "b"], [["x", 1.234], ["y", float("nan")], ["z", None]])
    lines = capsys.readouterr().out.splitlines()
    assert [line.split() for line in lines] == [["a", "b"], ["x", "1.23"], ["y", "–"], ["z", "–"]]
    assert figure(True) == "yes"


def test_long_cells_are_not_cut_in_a_pipe(capsys: pytest.CaptureFixture[str]) -> None:
    Console().table(["file", "reason"], [["a.csv", "word " * 60]])
    assert capsys.readouterr().out.count("word") == 60


def test_json_has_no_nan(tmp_path: Path) -> None:
    write_json(tmp_path / "x.json", {"a": float("nan"), "b": [float("inf"), 1.5], 3: (Path("p"),)})
    assert json.loads((tmp_path / "x.json").read_text()) == {"a": None, "b": [None, 1.5], "3": ["p"]}


def test_assignments() -> None:
    given = ["particles=200", "level_pitch=false", "dem_window=tin", "x=a=b", "text="]
    assert parse_assignments(given, "--option") == {
        "particles": 200,
        "level_pitch": False,
        "dem_window": "tin",
        "x": "a=b",
        "text": "",
    }
    for wrong in ("particles", "=3"):
        with pytest.raises(typer.BadParameter):
            parse_assignments([wrong], "--option")


def test_boxes() -> None:
    assert parse_box(None) is None
    assert parse_box("8.46,48.95, 8.5,48.99") == (8.46, 48.95, 8.5, 48.99)
    for wrong in ("1,2,3", "a,b,c,d", "3,0,2,1", "0,-91,1,1", "nan,0,1,1"):
        with pytest.raises(typer.BadParameter):
            parse_box(wrong)


def test_columns_of_a_csv_may_be_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("a.csv").write_text("t;breite;laenge;hoehe\n2018-05-04T15:34:20Z;49;8;112,5\n", encoding="utf-8")
    arguments = ["track", "a.csv", "-o", "out.csv", "--json", "out.json"]
    refused = runner.invoke(app, arguments)
    assert refused.exit_code == 1
    assert (
        "lacks required columns: time_s (Unix seconds) or time (RFC 3339), lat_deg, lon_deg" in refused.stderr
    )
    names = {"time": "t", "lat_deg": "breite", "lon_deg": "laenge", "alt_msl_m": "hoehe"}
    named = [part for ours, theirs in names.items() for part in ("--columns", f"{ours}={theirs}")]
    done = runner.invoke(app, [*arguments, *named])
    assert done.exit_code == 0, done.output
    assert "112.5" in Path("out.csv").read_text(encoding="utf-8")
    missed = runner.invoke(app, [*arguments, *named, "--columns", "height_ell_m=Hoehen"])
    assert missed.exit_code == 1
    assert "no 'Hoehen'" in missed.stderr
    assert "Did you mean 'hoehe'" in missed.stderr
