"""What satellites send and receivers measure of it: raw signals and broadcast ephemerides, as read from files.

Positions are computed from them in ``fusion.gnss``; here are only the tables and the scales of time that files are
written in. GPS seconds count from 1980-01-06 00:00:00 without leap seconds; every other scale is turned into them.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from typing import Self

import numpy as np

from fusion.arrays import Bools, ColumnTable, Floats, Ints

SYSTEMS = "GRECJS"
"""Letters of the systems as RINEX has them; a system's number is its place here: GPS, GLONASS, Galileo, BeiDou, QZSS,
SBAS."""
GPS, GLONASS, GALILEO, BEIDOU, QZSS, SBAS = range(6)
CARRIER_HZ = np.array([1575.42e6, 1602.0e6, 1575.42e6, 1561.098e6, 1575.42e6, 1575.42e6])
"""Carrier of the L1 band by system, where a signal does not state its own: BeiDou's is B1I, GLONASS's its channel 0."""
GLONASS_STEP_HZ = 562_500.0
"""Centre of GLONASS's channel k: that of channel 0, and k of these (ICD 5.1, section 3.3.1.1)."""

LIGHT_MPS = 299_792_458.0
GPS_EPOCH_S = 315_964_800.0
"""1980-01-06 in Unix seconds."""
WEEK_S = 604_800.0
BEIDOU_LATE_S = 14.0
"""GPS time minus BeiDou time (its week 0 began on 2006-01-01, GPS week 1356)."""
BEIDOU_WEEK_0 = 1356
GLONASS_AHEAD_S = 10_800.0
"""GLONASS time minus UTC."""

# Days on which a leap second took effect since the GPS epoch, as Unix seconds (IERS Bulletin C).
_LEAPS_UNIX_S = np.array(
    ["1981-07-01", "1982-07-01", "1983-07-01", "1985-07-01", "1988-01-01", "1990-01-01", "1991-01-01",
     "1992-07-01", "1993-07-01", "1994-07-01", "1996-01-01", "1997-07-01", "1999-01-01", "2006-01-01",
     "2009-01-01", "2012-07-01", "2015-07-01", "2017-01-01"],
    dtype="datetime64[s]",
).astype(np.float64)  # fmt: skip


def gps_from_unix(unix_s: Floats) -> Floats:
    """GPS seconds (n,) of UTC Unix seconds (n,)."""
    unix_s = np.asarray(unix_s, float)
    return unix_s - GPS_EPOCH_S + np.searchsorted(_LEAPS_UNIX_S, unix_s, side="right")


def unix_from_gps(gps_s: Floats) -> Floats:
    """UTC Unix seconds (n,) of GPS seconds (n,)."""
    gps_s = np.asarray(gps_s, float)
    began = _LEAPS_UNIX_S - GPS_EPOCH_S + np.arange(1, len(_LEAPS_UNIX_S) + 1)
    return gps_s + GPS_EPOCH_S - np.searchsorted(began, gps_s, side="right")


def satellite_name(system: int, number: int) -> str:
    """As RINEX writes it: ``G07``."""
    return f"{SYSTEMS[system]}{number:02d}"


@dataclass(frozen=True)
class Signals:
    """Measurements on the L1 band (L1 C/A, G1, E1, B1), one row a satellite and epoch; at most one row for each pair.

    Rows ``first[k]:first[k + 1]`` belong to epoch k. ``gps_s`` (m,) is the receiver's own time tag, strictly
    increasing. ``number`` is the satellite's within its system as RINEX has it (a GLONASS slot, 193 to 202 less 192 for
    QZSS). ``pseudorange_m`` is as measured; ``range_rate_mps`` is minus wavelength times Doppler, positive where the
    satellite recedes; ``cn0_dbhz`` and ``sigma_m`` (the receiver's own of the pseudorange) as stated.
    ``position_m`` and ``velocity_mps`` (n, 3) are the satellites' in ECEF, for logs that bring them with them: at the
    time of transmission, in the frame of that moment. Such pseudoranges are taken to be free of satellite clock and
    atmosphere. Unknown is NaN.
    """

    gps_s: Floats
    first: Ints
    system: Ints
    number: Ints
    pseudorange_m: Floats
    range_rate_mps: Floats
    cn0_dbhz: Floats
    sigma_m: Floats
    frequency_hz: Floats
    position_m: Floats
    velocity_mps: Floats

    def __post_init__(self) -> None:
        n = len(self.system)
        for spec in fields(self):
            kind = np.int64 if spec.name in ("first", "system", "number") else np.float64
            column = np.ascontiguousarray(getattr(self, spec.name), dtype=kind)
            wanted: tuple[int, ...] = (n, 3) if spec.name in ("position_m", "velocity_mps") else (n,)
            if spec.name in ("gps_s", "first"):
                wanted = (len(self.gps_s) + (spec.name == "first"),)
            if column.shape != wanted:
                raise ValueError(f"Signals.{spec.name} has shape {column.shape}, expected {wanted}")
            object.__setattr__(self, spec.name, column)
        if np.any(np.diff(self.gps_s) <= 0) or self.first[0] != 0 or self.first[-1] != n:
            raise ValueError("Signals: epochs must increase strictly, and their rows fill the table")

    def __len__(self) -> int:
        """How many epochs there are."""
        return len(self.gps_s)

    @property
    def epoch(self) -> Ints:
        """The epoch of each row, (n,)."""
        return np.repeat(np.arange(len(self)), np.diff(self.first))

    @property
    def time_s(self) -> Floats:
        """The time tags in UTC Unix seconds, (m,)."""
        return unix_from_gps(self.gps_s)

    @property
    def brings_satellites(self) -> bool:
        """Whether the log itself says where the satellites were."""
        return bool(np.isfinite(self.position_m).all()) and len(self.system) > 0

    @classmethod
    def empty(cls) -> Self:
        """Without any epoch."""
        return cls.assemble(np.empty(0), np.empty(0, np.int64), np.empty(0, np.int64))

    @classmethod
    def assemble(cls, row_gps_s: Floats, system: Ints, number: Ints, **columns: Floats) -> Self:
        """Build from rows in any order, (n,) each; columns not given are NaN.

        Of rows of one satellite at one time, the first is kept; rows without a time or a pseudorange are dropped.
        """
        row_gps_s = np.asarray(row_gps_s, float)
        n = len(row_gps_s)
        names = [spec.name for spec in fields(cls)][4:]
        shapes = {name: (n, 3) if name in ("position_m", "velocity_mps") else (n,) for name in names}
        table: dict[str, Floats] = {
            name: np.asarray(columns.get(name, np.full(shapes[name], np.nan))) for name in names
        }
        system, number = np.asarray(system, np.int64), np.asarray(number, np.int64)
        order = np.lexsort((np.arange(n), number, system, row_gps_s))
        order = order[np.isfinite(row_gps_s[order]) & np.isfinite(table["pseudorange_m"][order])]
        key = np.column_stack([row_gps_s[order], system[order], number[order]])
        new = np.ones(len(order), bool)
        new[1:] = np.any(key[1:] != key[:-1], axis=1)
        order = order[new]
        times, first = np.unique(row_gps_s[order], return_index=True)
        return cls(
            gps_s=times,
            first=np.append(first, len(order)).astype(np.int64),
            system=system[order],
            number=number[order],
            **{name: column[order] for name, column in table.items()},
        )

    def take_rows(self, keep: Bools) -> Signals:
        """The rows that a mask (n,) selects; epochs stay, if without rows."""
        counts = np.bincount(self.epoch[keep], minlength=len(self))
        columns = {spec.name: getattr(self, spec.name)[keep] for spec in fields(self)[2:]}
        return Signals(gps_s=self.gps_s, first=np.append(0, np.cumsum(counts)), **columns)


@dataclass(frozen=True)
class KeplerEphemerides(ColumnTable):
    """Broadcast ephemerides of GPS, Galileo, BeiDou and QZSS, one row a record, (k,) each; angles in radians.

    ``toe_s``, ``toc_s`` and ``sent_s`` (NaN where not stated) are GPS seconds, for BeiDou and Galileo too.
    ``group_delay_s`` is what single-frequency users of the L1 band take off the satellite's clock: TGD (GPS, QZSS),
    BGD E1/E5b (Galileo I/NAV; E5a/E1 for F/NAV), TGD1 (BeiDou). ``accuracy_m`` is the stated user range accuracy.
    """

    system: Ints
    number: Ints
    toe_s: Floats
    toc_s: Floats
    sent_s: Floats
    healthy: Bools
    accuracy_m: Floats
    issue: Ints
    root_a: Floats
    """Square root of the semi-major axis, m^0.5."""
    eccentricity: Floats
    m0_rad: Floats
    delta_n_radps: Floats
    omega0_rad: Floats
    omega_rad: Floats
    omega_dot_radps: Floats
    i0_rad: Floats
    i_dot_radps: Floats
    cuc_rad: Floats
    cus_rad: Floats
    crc_m: Floats
    crs_m: Floats
    cic_rad: Floats
    cis_rad: Floats
    af0_s: Floats
    af1: Floats
    af2_per_s: Floats
    group_delay_s: Floats


@dataclass(frozen=True)
class GlonassEphemerides(ColumnTable):
    """Broadcast states of GLONASS satellites in PZ-90 (taken for WGS 84: they agree to centimetres), one row a record.

    ``toe_s`` in GPS seconds; ``clock_s`` is what is to be added to the satellite's reading as RINEX has it (-TauN),
    ``clock_rate`` its relative frequency (GammaN). ``position_m``, ``velocity_mps`` and ``acceleration_mps2`` (of sun
    and moon) have shape (k, 3). ``channel`` gives the frequency: 1602 MHz + channel x 562.5 kHz.
    """

    VECTORS = ("position_m", "velocity_mps", "acceleration_mps2")

    number: Ints
    channel: Ints
    toe_s: Floats
    healthy: Bools
    clock_s: Floats
    clock_rate: Floats
    position_m: Floats
    velocity_mps: Floats
    acceleration_mps2: Floats


@dataclass(frozen=True)
class Navigation:
    """All that navigation files or messages say; ``klobuchar`` are alpha 0..3 (s, s/semicircle ...) and beta 0..3."""

    kepler: KeplerEphemerides = field(default_factory=KeplerEphemerides.empty)
    glonass: GlonassEphemerides = field(default_factory=GlonassEphemerides.empty)
    klobuchar: tuple[float, ...] | None = None

    def __len__(self) -> int:
        """How many records there are."""
        return len(self.kepler) + len(self.glonass)

    def joined(self, other: Navigation) -> Navigation:
        """What both say; of two ionospheres, this one."""
        return Navigation(
            self.kepler.joined(other.kepler),
            self.glonass.joined(other.glonass),
            self.klobuchar or other.klobuchar,
        )


@dataclass(frozen=True)
class RawGnss:
    """The raw side of a log: what was measured, and what is needed to make positions of it.

    ``place_m`` (3,) is where the log says that its receiver stood, ECEF: bases do. ``base`` is the raw side of a base's
    log, by whose ``place_m`` pseudoranges are corrected (``fusion.gnss.differential``).
    """

    signals: Signals = field(default_factory=Signals.empty)
    navigation: Navigation = field(default_factory=Navigation)
    place_m: Floats | None = None
    base: RawGnss | None = None

    def beside(self, base: RawGnss) -> RawGnss:
        """The same with a base, which knows the ephemerides of both."""
        return replace(self, base=replace(base, navigation=base.navigation.joined(self.navigation)))
