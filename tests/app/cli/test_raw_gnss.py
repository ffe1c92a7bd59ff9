"""Raw pseudoranges through the commands: files that belong together, solvers by name, and what is written of them."""

from __future__ import annotations

import csv
import json
import zipfile
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from typer.testing import CliRunner, Result

from app.cli import app
from fusion.frames import geodetic
from fusion.published.canyon.drive import canyon_of, simulate_canyon
from fusion.published.canyon.fronts import NO_FRONTS
from fusion.published.canyon.radio import TOWN
from fusion.published.canyon.ride import Ride
from fusion.signals import Signals
from fusion.simulate.drive import SimulatedDrive, simulate_drive
from fusion.simulate.scene.town import make_town
from fusion.simulate.write.csv_file import write_csv
from fusion.simulate.write.osm_file import write_osm
from fusion.simulate.write.rinex_file import navigation, observations
from fusion.simulate.write.ubx_file import write_ubx

runner = CliRunner()


class Files(NamedTuple):
    """A drive as RINEX in a folder, as UBX, and as a log without raw data."""

    drive: SimulatedDrive
    roads: Path
    folder: Path
    ubx: Path
    plain: Path


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Files:
    place = tmp_path_factory.mktemp("raw")
    drive = simulate_drive(make_town(1), 5, 120.0)
    raw = canyon_of(drive).raw()
    folder = place / "rinex"
    folder.mkdir()
    (folder / "drive.rnx").write_text(observations(raw.signals))
    (folder / "brdc.rnx").write_text(navigation(raw.navigation))
    (folder / ".hidden").write_text("not a log")
    found = Files(drive, place / "town.osm", folder, place / "drive.ubx", place / "plain.csv")
    write_osm(drive.town, found.roads)
    write_ubx(drive, found.ubx, raw)
    write_csv(drive, found.plain)
    return found


def run(*arguments: str | Path) -> Result:
    return runner.invoke(app, [str(a) for a in arguments])


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def errors_m(drive: SimulatedDrive, track: list[dict[str, str]]) -> np.ndarray:
    """Horizontal errors of a written track."""
    lon, lat, time = (np.array([float(row[n]) for row in track]) for n in ("lon_deg", "lat_deg", "time_s"))
    x, y = drive.town.projection.to_xy(lon, lat)
    true_x, true_y = (np.interp(time, drive.time_s, v) for v in (drive.truth.x_m, drive.truth.y_m))
    return np.hypot(x - true_x, y - true_y)


def test_observations_and_navigation_are_one_drive_however_they_are_named(
    files: Files, tmp_path: Path
) -> None:
    observed, broadcast = files.folder / "drive.rnx", files.folder / "brdc.rnx"
    with zipfile.ZipFile(tmp_path / "both.zip", "w") as archive:
        archive.write(observed, "drive.rnx")
        archive.write(broadcast, "brdc.rnx")
    out = []
    for number, given in enumerate(
        (
            [observed, broadcast, "--together"],
            [broadcast, observed, "--together"],
            [files.folder],
            [tmp_path / "both.zip"],
        )
    ):
        path = tmp_path / f"{number}.csv"
        result = run("track", *given, "-o", path)
        assert result.exit_code == 0, result.stderr
        out.append(path.read_text())
    assert out[1:] == out[:1] * 3
    track = rows(tmp_path / "0.csv")
    assert len(track) == len(files.drive.time_s)
    assert np.mean(errors_m(files.drive, track)) < 3.0


def test_a_track_of_a_solver_tells_covariances_and_reflections(files: Files, tmp_path: Path) -> None:
    path = tmp_path / "track.csv"
    assert run("track", files.folder, "--gnss", "one-sided", "-o", path).exit_code == 0
    first = rows(path)[0]
    covariance = np.array(
        [[float(first[f"cov_{''.join(sorted((a, b), key='enu'.index))}_m2"]) for b in "enu"] for a in "enu"]
    )
    assert np.all(np.linalg.eigvalsh(covariance) > 0)
    assert first["predicted"] == "0"
    told = dict(part.split("=") for part in first["reflected"].split())
    assert len(told) > 5
    assert all(0 <= float(share) <= 1 for share in told.values())
    drawn = tmp_path / "track.geojson"
    assert run("track", files.folder, "-o", drawn).exit_code == 0
    point = json.loads(drawn.read_text())["features"][1]["properties"]
    assert set(point["reflected"]) == set(told)


def test_ubx_with_raw_messages_alone_gives_slopes(files: Files, tmp_path: Path) -> None:
    figures = tmp_path / "figures.json"
    result = run(
        "fuse", files.ubx, "--roads", files.roads, "--gnss", "one-sided", "-o", tmp_path / "out.csv", "--json", figures
    )  # fmt: skip
    assert result.exit_code == 0, result.stderr
    (log,) = json.loads(figures.read_text())["logs"]
    assert log["segments"] > 3
    assert log["report"]["gnss"]["positioning"] == "one-sided"
    assert log["report"]["options"]["gnss"] == "one-sided"


def test_a_drive_without_its_navigation_is_refused_and_says_what_to_add(files: Files, tmp_path: Path) -> None:
    result = run("fuse", files.folder / "drive.rnx", "--roads", files.roads, "-o", tmp_path / "out.csv")
    assert result.exit_code == 1
    assert "navigation file" in result.stderr
    alone = run("track", files.folder / "brdc.rnx", "-o", tmp_path / "out.csv")
    assert alone.exit_code == 1
    assert "navigation" in alone.stderr


def test_a_log_without_raw_data_is_refused_in_one_line(files: Files, tmp_path: Path) -> None:
    result = run(
        "fuse", files.plain, "--roads", files.roads, "--gnss", "rbpf-dpm", "-o", tmp_path / "out.csv"
    )
    assert result.exit_code == 1
    (line,) = result.stderr.strip().splitlines()
    assert "'rbpf-dpm' needs raw pseudoranges" in line
    assert "this log has none" in line


@pytest.mark.parametrize(
    ("given", "said"),
    [(("--gnss", "best"), "one-sided"), (("--gnss", "pf", "--gnss-option", "particels=5"), "particles")],
)
def test_wrong_names_are_wrong_usage(given: tuple[str, ...], said: str, files: Files, tmp_path: Path) -> None:
    for command in (("fuse", "--roads", files.roads), ("track",)):
        result = run(command[0], files.folder, *command[1:], *given, "-o", tmp_path / "out.csv")
        assert result.exit_code == 2
        assert said in result.stderr


class Base(NamedTuple):
    """Files of a base under open sky, and of the drive that shares its errors."""

    rover: Path
    station: Path
    placeless: Path
    place: str


@pytest.fixture(scope="module")
def base(files: Files, tmp_path_factory: pytest.TempPathFactory) -> Base:
    folder, drive = tmp_path_factory.mktemp("base"), files.drive
    raw = canyon_of(drive, everywhere="open").raw()
    place_m, still_mps = (
        np.tile([4000.0, -3000.0, 90.0], (len(drive.time_s), 1)),
        np.zeros((len(drive.time_s), 3)),
    )
    ride = Ride.on_plane(drive.time_s, place_m, still_mps, drive.town.projection)
    still = simulate_canyon(ride, NO_FRONTS, TOWN, raw.navigation, np.random.default_rng(3)).raw()

    def shared(signals: Signals) -> Signals:
        wrong = 6.0 * np.sin(5.0 * signals.number + signals.system)
        return replace(signals, pseudorange_m=signals.pseudorange_m + wrong)

    rover, station, placeless = folder / "rover", folder / "station.rnx", folder / "placeless.rnx"
    rover.mkdir()
    (rover / "drive.rnx").write_text(observations(shared(raw.signals)))
    (rover / "brdc.rnx").write_text(navigation(raw.navigation))
    station.write_text(observations(shared(still.signals), ride.position_m[0]))
    placeless.write_text(observations(shared(still.signals)))
    lon, lat, height = (float(v[0]) for v in geodetic(ride.position_m[:1]))
    return Base(rover, station, placeless, f"{lat},{lon},{height}")


def test_a_base_corrects_the_drive(files: Files, base: Base, tmp_path: Path) -> None:
    """By the place in its header or by the one given; its ephemerides are those of the drive."""
    ways: dict[str, list[str | Path]] = {
        "alone": [],
        "header": ["--base", base.station],
        "given": ["--base", base.placeless, "--base-place", base.place],
    }
    errors = {}
    for name, more in ways.items():
        out = tmp_path / f"{name}.csv"
        found = run(
            "track", base.rover, "--gnss", "wls", "-o", out, *more, "--json", tmp_path / f"{name}.json"
        )
        assert found.exit_code == 0, found.output
        errors[name] = errors_m(files.drive, rows(out))
    assert np.median(errors["header"]) < 0.5 * np.median(errors["alone"])
    np.testing.assert_allclose(errors["given"], errors["header"], atol=0.01)
    (log,) = json.loads((tmp_path / "header.json").read_text())["logs"]
    assert log["gnss"]["counts"]["corrected by the base"] > 1000


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (["--base", "PLACELESS"], "--base-place LAT,LON,HEIGHT"),
        (["--base", "PLACELESS", "--base-place", "48.0,8.0"], "is not LAT,LON,HEIGHT"),
        (["--base", "PLACELESS", "--base-place", "48.0,8.0,100"], "from where its own pseudoranges put it"),
        (["--base-place", "48.0,8.0,100"], "no --base is given"),
        (["--base", "PLAIN"], "holds no pseudoranges"),
        (["--base", "missing.rnx"], "missing.rnx"),
    ],
)
def test_a_base_of_no_use_is_refused(
    files: Files, base: Base, tmp_path: Path, more: list[str], said: str
) -> None:
    given = [{"PLACELESS": str(base.placeless), "PLAIN": str(files.plain)}.get(word, word) for word in more]
    found = run("track", base.rover, "--gnss", "wls", "-o", tmp_path / "out.csv", *given)
    assert found.exit_code != 0
    assert said in " ".join(found.output.replace("│", " ").split())
