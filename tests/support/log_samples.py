"""Small logs of every format, built here; UBX by pyubx2, so that the reader meets a foreign writer."""

from __future__ import annotations

import math
from datetime import UTC, datetime, timedelta
from typing import Any

from pyubx2 import GET, UBXMessage

from fusion.signals import Signals, satellite_name
from fusion.simulate.write import rinex_file
from garmin_files import drive_fit, gpx, tcx, track
from gnss_tables import some_signals

START = datetime(2018, 5, 4, 15, 34, 20, tzinfo=UTC)
LEAP_S = 18
WEEK_START = datetime(2018, 4, 29, tzinfo=UTC)  # a Sunday

THESIS_DUMP = """\
-----
01 07 NAV-PVT    - 8C 3B : 8C 3B 100
NAV-PVT 401678000      -8451 3
    18833166  509502524      38091      -7563      971      1636
        0        1        -10        1  18558394      115      237647
    1.59 14
TOW:401677.999991549
3-D Fix
LLH:    1.8833166    50.9502524    38.091    -7.563    45.654
-----
10 03 ESF-RAW      - 03 DF : 03 DF 572
ESF-RAW          346146 TTAG:   346.146

16 Accelerometer X      FFFD7D      -0.628      8738081
17 Accelerometer Y      000144       0.316      8738081
18 Accelerometer Z      00273C       9.809      8738081
14 Gyroscope X          00053E       0.328      8738081
13 Gyroscope Y          FFF9A8      -0.396      8738081
5 Gyroscope Z           000731       0.449      8738081
12 Gyroscope Temp       00060B       15.47      8738081
-----
10 02 ESF-MEAS    - D1 3D : D1 3D 36
ESF-MEAS          346155 TTAG:   346.155 FLAGS:2018 ID:0000
Time Mark Signal : None
Time Mark Edge  : Rising
calibTtagValid

14 Gyroscope X      000556       0.333
13 Gyroscope Y      FFF9C5      -0.389
5 Gyroscope Z       000721       0.446
12 Gyroscope Temp   000609       15.45

346155    346.155 timetag   (Sensor Time Tag)
346155    346.155 calibtTag (Receiver Time Tag)
-----
10 02 ESF-MEAS   - AC 7A : AC 7A 32
ESF-MEAS      346160 TTAG:   346.160 FLAGS:1818 ID:0000
Time Mark Signal : None
Time Mark Edge  : Rising
calibTtagValid

    16 Accelerometer X      FFFD76      -0.635
    17 Accelerometer Y      000142       0.314
    18 Accelerometer Z      002749       9.821

    346160    346.160 timetag  (Sensor Time Tag)
    346160    346.160 calibtTag (Receiver Time Tag)
-----
01 05 NAV-ATT   - 9D A9 : 9D A9 40
NAV-ATT 401678000 0
    271816   -6819019   18558394
    38143     38612     237647
TOW:401678.000
    2.71816   -68.19019   185.58394
-----
"""


def itow_ms(when: datetime) -> int:
    """GPS time of week of a UTC time, milliseconds."""
    return round(((when - WEEK_START).total_seconds() + LEAP_S) % 604800 * 1000)


def pvt(when: datetime = START, **fields: Any) -> bytes:
    """One NAV-PVT by pyubx2."""
    default = {
        "iTOW": itow_ms(when), "year": when.year, "month": when.month, "day": when.day, "hour": when.hour,
        "min": when.minute, "second": when.second, "nano": when.microsecond * 1000,
        "validDate": 1, "validTime": 1, "fullyResolved": 1, "tAcc": 20, "fixType": 3, "gnssFixOk": 1,
        "numSV": 14, "lon": 1.8833166, "lat": 50.9502524, "height": 38091, "hMSL": -7563, "hAcc": 971,
        "vAcc": 1636, "velN": 7000, "velE": -1500, "velD": -210, "gSpeed": 7159, "headMot": 347.9,
        "sAcc": 115, "headAcc": 2.4, "pDOP": 1.59,
    }  # fmt: skip
    return bytes(UBXMessage("NAV", "NAV-PVT", GET, **(default | fields)).serialize())


def att(when: datetime = START, **fields: Any) -> bytes:
    """One NAV-ATT by pyubx2."""
    default = {
        "iTOW": itow_ms(when), "roll": 2.71816, "pitch": -6.81901, "heading": 185.58394, "accRoll": 0.38143,
        "accPitch": 0.38612, "accHeading": 2.37647,
    }  # fmt: skip
    return bytes(UBXMessage("NAV", "NAV-ATT", GET, **(default | fields)).serialize())


def eoe(when: datetime = START) -> bytes:
    """One NAV-EOE by pyubx2."""
    return bytes(UBXMessage("NAV", "NAV-EOE", GET, iTOW=itow_ms(when)).serialize())


def esf_meas(tag: int, words: list[tuple[int, int]], calibrated: bool = True, sensor: int = 0) -> bytes:
    """One ESF-MEAS by pyubx2; words are (type, 24 data bits)."""
    flags = (len(words) << 11) | 8 * calibrated
    payload = tag.to_bytes(4, "little") + flags.to_bytes(2, "little") + sensor.to_bytes(2, "little")
    payload += b"".join((t << 24 | v & 0xFFFFFF).to_bytes(4, "little") for t, v in words)
    if calibrated:
        payload += tag.to_bytes(4, "little")
    return bytes(UBXMessage(0x10, 0x02, GET, payload=payload).serialize())


def esf_raw(words: list[tuple[int, int, int]]) -> bytes:
    """One ESF-RAW by pyubx2; words are (type, 24 data bits, time tag)."""
    payload = bytes(4)
    for kind, value, tag in words:
        payload += (kind << 24 | value & 0xFFFFFF).to_bytes(4, "little") + (tag % 2**32).to_bytes(4, "little")
    return bytes(UBXMessage(0x10, 0x03, GET, payload=payload).serialize())


def nmea(body: str) -> bytes:
    """A sentence with its checksum, from what stands between $ and *."""
    total = 0
    for byte in body.encode():
        total ^= byte
    return f"${body}*{total:02X}\r\n".encode()


def _angle(value: float, digits: int) -> str:
    degrees = math.floor(abs(value))
    return f"{degrees:0{digits}d}{(abs(value) - degrees) * 60:08.5f}"


def burst(
    when: datetime, lat: float, lon: float, *, talker: str = "GN", kinds: str = "RMC VTG GGA GST"
) -> bytes:
    """One epoch of sentences as a u-blox receiver writes them."""
    clock = when.strftime("%H%M%S.") + f"{when.microsecond // 10000:02d}"
    y, x = f"{_angle(lat, 2)},{'N' if lat >= 0 else 'S'}", f"{_angle(lon, 3)},{'E' if lon >= 0 else 'W'}"
    bodies = {
        "RMC": f"{talker}RMC,{clock},A,{y},{x},13.915,347.91,{when:%d%m%y},,,A",
        "VTG": f"{talker}VTG,347.91,T,,M,13.915,N,25.771,K,A",
        "GGA": f"{talker}GGA,{clock},{y},{x},1,12,0.79,112.3,M,45.6,M,,",
        "GST": f"{talker}GST,{clock},15,,,,0.9,1.2,2.4",
        "ZDA": f"{talker}ZDA,{clock},{when:%d,%m,%Y},00,00",
    }
    return b"".join(nmea(bodies[kind]) for kind in kinds.split())


def drive_ubx(epochs: int = 20) -> bytes:
    """A UBX drive: navigation at 1 Hz, sensors at 10 Hz between, time tags of the sensors' own."""
    out = bytearray()
    for k in range(epochs):
        when = START + timedelta(seconds=k)
        out += pvt(when, lat=50.95 + 6e-5 * k) + att(when) + eoe(when)
        for j in range(10):
            tag = 346000 + 1000 * k + 100 * j + 50
            out += esf_meas(tag, [(14, 0x556), (13, -0x63B), (5, 0x721), (12, 0x609)])
            out += esf_meas(tag, [(16, -650), (17, 322), (18, 10057)])
    return bytes(out)


def drive_nmea(epochs: int = 20, start: datetime = START, **how: Any) -> bytes:
    """An NMEA drive at 1 Hz."""
    return b"".join(burst(start + timedelta(seconds=k), 50.95 + 6e-5 * k, 1.88, **how) for k in range(epochs))


def csv(rows: int = 20) -> bytes:
    """A Versant CSV drive."""
    out = [
        "time_s,lat_deg,lon_deg,alt_msl_m,speed_mps,heading_deg,acc_x_mps2,acc_y_mps2,acc_z_mps2,pitch_deg"
    ]
    for k in range(rows):
        out.append(
            f"{START.timestamp() + k},{50.95 + 6e-5 * k:.7f},1.88,{112 + k / 10},7.1,348,0.1,0.2,9.8,1.5"
        )
    return ("\n".join(out) + "\n").encode()


RAW_COLUMNS = (
    "utcTimeMillis,TimeNanos,LeapSecond,TimeUncertaintyNanos,FullBiasNanos,BiasNanos,BiasUncertaintyNanos,"
    "DriftNanosPerSecond,DriftUncertaintyNanosPerSecond,HardwareClockDiscontinuityCount,Svid,TimeOffsetNanos,State,"
    "ReceivedSvTimeNanos,ReceivedSvTimeUncertaintyNanos,Cn0DbHz,PseudorangeRateMetersPerSecond,"
    "PseudorangeRateUncertaintyMetersPerSecond,AccumulatedDeltaRangeState,AccumulatedDeltaRangeMeters,"
    "AccumulatedDeltaRangeUncertaintyMeters,CarrierFrequencyHz,CarrierCycles,CarrierPhase,CarrierPhaseUncertainty,"
    "MultipathIndicator,SnrInDb,ConstellationType,AgcDb"
)
FIX_COLUMNS = (
    "Provider,LatitudeDegrees,LongitudeDegrees,AltitudeMeters,SpeedMps,AccuracyMeters,BearingDegrees,UnixTimeMillis,"
    "SpeedAccuracyMps,BearingAccuracyDegrees,elapsedRealtimeNanos,VerticalAccuracyMeters"
)
FULL_BIAS_NANOS = -1_209_483_250_123_456_789
"""Of a phone whose own clock began some days before START."""
ANDROID_SYSTEM = {"G": 1, "S": 2, "R": 3, "J": 4, "C": 5, "E": 6}


def raw_line(letter: str, number: int, clock_ns: int, flight_ns: int, **cells: object) -> str:
    """A Raw line of a satellite (its letter and number in RINEX) whose signal took ``flight_ns`` to come."""
    received = clock_ns - FULL_BIAS_NANOS
    sent = received - flight_ns
    if letter == "R":
        sent = (sent + (10_800 - LEAP_S) * 10**9) % (86_400 * 10**9)
    else:
        sent = (sent - (14 * 10**9 if letter == "C" else 0)) % (604_800 * 10**9)
    values = dict.fromkeys(RAW_COLUMNS.split(","), "")
    values |= {
        "utcTimeMillis": "1525448060000", "TimeNanos": str(clock_ns), "FullBiasNanos": str(FULL_BIAS_NANOS),
        "BiasNanos": "0.0", "HardwareClockDiscontinuityCount": "3", "TimeOffsetNanos": "0.0",
        "Svid": str(number + {"S": 100, "J": 192}.get(letter, 0)), "State": "32911" if letter == "R" else "16399",
        "ReceivedSvTimeNanos": str(sent), "ReceivedSvTimeUncertaintyNanos": "20", "Cn0DbHz": "40.5",
        "PseudorangeRateMetersPerSecond": "-321.5", "CarrierFrequencyHz": "1575420030",
        "ConstellationType": str(ANDROID_SYSTEM[letter]),
    }  # fmt: skip
    values |= {name: str(value) for name, value in cells.items()}
    return "Raw," + ",".join(values.values())


def gnsslogger(lines: list[str]) -> bytes:
    """A GnssLogger text with its header."""
    head = f"# \n# Header Description:\n# \n# Version: v3.0.6.4 Platform: 14\n# \n# Raw,{RAW_COLUMNS}\n# \n"
    head += f"# Accel,utcTimeMillis,elapsedRealtimeNanos,AccelXMps2\n# Fix,{FIX_COLUMNS}\n# \n"
    return (head + "\n".join(lines) + "\n").encode()


def drive_gnsslogger(epochs: int = 20) -> bytes:
    """A phone's drive at 1 Hz: a fix, and four satellites."""
    lines = []
    for k in range(epochs):
        ms = round((START.timestamp() + k) * 1000)
        lines.append(f"Fix,GPS,{50.95 + 6e-5 * k:.7f},1.88,158.2,7.1,3.8,348,{ms},0.2,,{k},5.0")
        lines.append(f"Fix,FLP,{51.95 + 6e-5 * k:.7f},1.88,158.2,7.1,3.8,348,{ms},0.2,,{k},5.0")
        lines.append(f"Accel,{ms},1,0.1,9.8,0.2")
        for letter, number in (("G", 7), ("R", 2), ("E", 11), ("C", 21)):
            lines.append(raw_line(letter, number, (1000 + k) * 10**9, 70_000_000 + 1_000_000 * number))
    return gnsslogger(lines)


def pseudoranges_csv(signals: Signals) -> bytes:
    """Raw measurements as a CSV."""
    out = ["time_s,sv,pseudorange_m,cn0_dbhz"]
    for r, k in enumerate(signals.epoch):
        name = satellite_name(signals.system[r], signals.number[r])
        out.append(
            f"{float(signals.time_s[k])!r},{name},{signals.pseudorange_m[r]:.3f},{signals.cn0_dbhz[r]:.2f}"
        )
    return ("\n".join(out) + "\n").encode()


def sensor_logger(epochs: int = 20) -> bytes:
    """A Location.csv of Sensor Logger."""
    out = [
        "time,seconds_elapsed,bearingAccuracy,speedAccuracy,verticalAccuracy,horizontalAccuracy,speed,bearing,"
        "altitude,longitude,latitude"
    ]
    for k in range(epochs):
        ns = round((START.timestamp() + k) * 1e9)
        out.append(f"{ns},{k}.0,5,0.3,3.2,4.1,7.1,348,{158 + k / 10},1.88,{50.95 + 6e-5 * k:.7f}")
    return ("\n".join(out) + "\n").encode()


def rtklib_pos(epochs: int = 20) -> bytes:
    """A solution of RTKLIB with velocities."""
    out = [
        "% program   : RTKPOST ver.2.4.3 b34",
        "% (lat/lon/height=WGS84/ellipsoidal,Q=1:fix,2:float,3:sbas,4:dgps,5:single,6:ppp,ns=# of satellites)",
        "%  GPST                  latitude(deg) longitude(deg)  height(m)   Q  ns   sdn(m)   sde(m)   sdu(m)  sdne(m)"
        "  sdeu(m)  sdun(m) age(s)  ratio    vn(m/s)    ve(m/s)    vu(m/s)      sdvn     sdve     sdvu",
    ]
    for k in range(epochs):
        when = START + timedelta(seconds=k + LEAP_S)
        out.append(
            f"{when:%Y/%m/%d %H:%M:%S}.000   {50.95 + 6e-5 * k:.9f}    1.880000000   {158 + k / 10:.4f}   1   9   "
            "0.0040   0.0030   0.0100   0.0010  -0.0010   0.0020   1.00    9.9    6.90000   -1.50000    0.10000   "
            "0.03000   0.03000   0.06000"
        )
    return ("\n".join(out) + "\n").encode()


def torque(rows: int = 20) -> bytes:
    """What Torque Pro logs."""
    out = [
        "GPS Time, Device Time, Longitude, Latitude,GPS Speed (Meters/second), Horizontal Dilution of Precision, "
        "Altitude, Bearing, G(x), G(y), G(z), G(calibrated),Speed (OBD)(km/h),Barometric pressure (from vehicle)(psi)"
    ]
    for k in range(rows):
        when = START + timedelta(seconds=k)
        out.append(
            f"{when + timedelta(hours=2):%a %b %d %H:%M:%S} GMT+02:00 {when:%Y},"
            f"{when + timedelta(hours=2):%d-%b-%Y %H:%M:%S}.250,1.88,{50.95 + 6e-5 * k:.7f},7.1,4.0,{112 + k / 10},348,"
            f"0.01,0.99,0.1,0.0,{25.6 if k else '-'},14.5"
        )
    return ("\n".join(out) + "\n").encode()


class Samples(dict[str, bytes]):
    """By the name of the format; of one that is missing it is said what to add."""

    def __missing__(self, name: str) -> bytes:
        raise AssertionError(
            f"There is no sample of the format {name!r}. Add a line to SAMPLES in tests/support/log_samples.py: a few "
            "epochs of such a file as bytes, made by a function beside the others there, at places of 1.8 to 1.9 E and "
            "50.9 to 51 N."
        )


SAMPLES = Samples(
    {
        "sensor-logger": sensor_logger(),
        "rtklib-pos": rtklib_pos(),
        "torque": torque(),
        "rinex": rinex_file.observations(some_signals(1, 6)).encode(),
        "fit": drive_fit(),
        "gnsslogger": drive_gnsslogger(),
        "pseudoranges-csv": pseudoranges_csv(some_signals(1, 4)),
        "ubx": drive_ubx(),
        "u-center": THESIS_DUMP.encode(),
        "nmea": drive_nmea(),
        "gpx": gpx(),
        "tcx": tcx([[track(0, 10), track(100, 10)]]),
        "csv": csv(),
    }
)
