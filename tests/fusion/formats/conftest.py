"""Small logs of every format (``log_samples``), for tests."""

from __future__ import annotations

from collections.abc import Iterator
from types import SimpleNamespace

import pytest

from garmin_files import gpx
from log_samples import (
    SAMPLES,
    START,
    THESIS_DUMP,
    att,
    burst,
    csv,
    drive_nmea,
    drive_ubx,
    eoe,
    esf_meas,
    esf_raw,
    gnsslogger,
    itow_ms,
    nmea,
    pvt,
    raw_line,
    rtklib_pos,
    sensor_logger,
    torque,
)  # fmt: skip


@pytest.fixture(scope="session")
def samples() -> dict[str, bytes]:
    """One small log per format of the registry."""
    return SAMPLES


@pytest.fixture(scope="session")
def make() -> Iterator[SimpleNamespace]:
    """The builders of this module, for tests (which cannot import each other)."""
    yield SimpleNamespace(
        pvt=pvt, att=att, eoe=eoe, esf_meas=esf_meas, esf_raw=esf_raw, nmea=nmea, burst=burst, gpx=gpx,
        drive_ubx=drive_ubx, drive_nmea=drive_nmea, itow_ms=itow_ms, start=START, start_s=START.timestamp(),
        csv=csv, thesis_dump=THESIS_DUMP, sensor_logger=sensor_logger,
        rtklib_pos=rtklib_pos, torque=torque, raw_line=raw_line, gnsslogger=gnsslogger,
    )  # fmt: skip
