"""Sensor Logger: a zip of one CSV a sensor is one drive."""

from __future__ import annotations

import io
import zipfile
from types import SimpleNamespace

import numpy as np
import pytest

from fusion.errors import EmptyLogError
from fusion.formats import read_log, read_logs
from fusion.formats.phones.mounting import STANDARD_GRAVITY, TURNED

START_S = 1_525_448_060
METADATA = (
    b"version,device name,recording epoch time,recording time,recording timezone,platform,appVersion,device id,sensors,"
    b"sampleRateMs,standardisation\n"
    b"3,Pixel 7,1525448060000,2018-05-04_15-34-20,Europe/Paris,android,1.29,x,Location,0,false\n"
)


def zipped(files: dict[str, bytes]) -> bytes:
    """A zip of files."""
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in files.items():
            archive.writestr(name, data)
    return out.getvalue()


def axes(time_s: np.ndarray, values: np.ndarray) -> bytes:
    """A file of a sensor of three axes, with the columns in the app's order."""
    rows = [
        f"{round(t * 1e9)},{t - START_S},{z},{y},{x}" for t, (x, y, z) in zip(time_s, values, strict=True)
    ]
    return ("time,seconds_elapsed,z,y,x\n" + "\n".join(rows) + "\n").encode()


def barometer(unit: float = 1.0) -> bytes:
    """20 s of a barometer."""
    rows = [f"{(START_S + k) * 10**9},{k},{-k / 10},{(1002.5 + k / 100) * unit}" for k in range(20)]
    return ("time,seconds_elapsed,relativeAltitude,pressure\n" + "\n".join(rows) + "\n").encode()


def a_drive() -> dict[str, bytes]:
    """Files of a phone that stands upright in its holder, its screen to the driver, on a drive with bends."""
    time = START_S + np.arange(0, 300, 0.1)
    speed = 11 + 4 * np.sin(time / 7)
    turn = 0.2 * np.sin(time / 11)
    course = -np.cumsum(turn) * 0.1
    ahead, left = np.gradient(speed, time), speed * turn
    # x to the right, y up, z to the driver
    moved = np.column_stack([-left, 0 * left, -ahead])
    gravity = np.tile([0.0, STANDARD_GRAVITY, 0.0], (len(time), 1))
    rate = np.column_stack([0 * turn, turn, 0 * turn])
    rows = [
        f"{round(time[k] * 1e9)},{time[k] - START_S},5,0.3,3,4,{speed[k]},{np.degrees(course[k]) % 360},158,49,"
        f"{1.88},{50.95 + 1e-5 * k}"
        for k in range(0, len(time), 10)
    ]
    head = (
        "time,seconds_elapsed,bearingAccuracy,speedAccuracy,verticalAccuracy,horizontalAccuracy,speed,bearing,altitude,"
        "altitudeAboveMeanSeaLevel,longitude,latitude\n"
    )
    return {
        "Location.csv": (head + "\n".join(rows) + "\n").encode(),
        "Barometer.csv": barometer(),
        "Accelerometer.csv": axes(time, moved),
        "Gravity.csv": axes(time, gravity),
        "Gyroscope.csv": axes(time, rate),
        "Magnetometer.csv": axes(time, rate + 30),
        "Orientation.csv": b"time,seconds_elapsed,qz,qy,qx,qw,roll,pitch,yaw\n1525448060000000000,0,0,0,0,1,0,0,0\n",
        "Metadata.csv": METADATA,
    }


@pytest.mark.parametrize("folder", ["", "2018-05-04_15-34-20/"])
def test_a_zip_is_one_drive_with_every_sensor_in_the_vehicles_axes(folder: str) -> None:
    log = read_log(zipped({folder + name: data for name, data in a_drive().items()}))
    assert log.source_format == "sensor-logger"
    assert {n: len(t) for n, t in log.tables().items() if len(t)} == {
        "fix": 300, "velocity": 300, "force": 3000, "rate": 3000, "pressure": 20,
    }  # fmt: skip
    assert (log.fix.height_ell_m[0], log.fix.alt_msl_m[0], log.fix.v_acc_m[0]) == (158, 49, 3)
    assert log.pressure.pressure_pa[0] == pytest.approx(100250)
    assert log.repaired[TURNED] == 1
    assert log.warnings == ()
    assert not log.skipped
    time = log.force.time_s
    assert log.force.acc_x_mps2 == pytest.approx(4 / 7 * np.cos(time / 7), abs=0.1)
    left = (11 + 4 * np.sin(time / 7)) * 0.2 * np.sin(time / 11)
    assert log.force.acc_y_mps2 - log.force.acc_y_mps2.mean() == pytest.approx(left - left.mean(), abs=0.1)
    assert log.rate.gyr_z_radps == pytest.approx(0.2 * np.sin(time / 11), abs=0.01)


def test_a_folders_files_are_read_as_the_zip() -> None:
    drive = a_drive()
    apart = read_logs([*drive.values()], names=[*drive])
    assert len(apart.force) == 3000


def test_an_iphones_forces_have_the_opposite_sign() -> None:
    drive = a_drive()
    time = START_S + np.arange(0, 300, 0.1)
    for name in ("Accelerometer.csv", "Gravity.csv"):
        rows = drive[name].decode().splitlines()[1:]
        values = [[-float(cell) for cell in row.split(",")[2:]][::-1] for row in rows]
        drive[name] = axes(time, np.array(values))
    turned, plain = read_log(zipped(drive)), read_log(zipped(a_drive()))
    for column in ("acc_x_mps2", "acc_y_mps2", "acc_z_mps2"):
        assert getattr(turned.force, column) == pytest.approx(getattr(plain.force, column), abs=0.02)
    assert turned.rate.gyr_z_radps == pytest.approx(plain.rate.gyr_z_radps, abs=1e-3)


def test_positions_alone_are_a_log(make: SimpleNamespace) -> None:
    log = read_log(make.sensor_logger(5))
    assert log.fix.time_s.tolist() == [START_S + k for k in range(5)]
    assert np.hypot(log.velocity.vel_n_mps, log.velocity.vel_e_mps) == pytest.approx(7.1)
    assert log.fix.h_acc_m[0] == 4.1


def test_below_zero_means_unknown() -> None:
    log = read_log(
        b"time,seconds_elapsed,bearingAccuracy,speedAccuracy,verticalAccuracy,horizontalAccuracy,speed,bearing,altitude,"
        b"longitude,latitude\n1525448060000000000,0,-1,-1,-1,-1,-1,-1,100,8,49\n"
    )
    assert log.missing[:3] == ("fix.alt_msl_m", "fix.h_acc_m", "fix.v_acc_m")
    assert not len(log.velocity)


def test_kilopascals_are_known_by_their_size() -> None:
    drive = a_drive() | {"Barometer.csv": barometer(0.1)}
    assert read_log(zipped(drive)).pressure.pressure_pa[0] == pytest.approx(100250)


@pytest.mark.parametrize("name", ["Accelerometer.csv", "Barometer.csv", "Metadata.csv"])
def test_a_file_without_positions_asks_for_the_others(name: str) -> None:
    with pytest.raises(EmptyLogError, match=r"Location\.csv"):
        read_log(a_drive()[name])
    drive = a_drive()
    del drive["Location.csv"]
    with pytest.raises(EmptyLogError, match="no usable position"):
        read_log(zipped(drive))
