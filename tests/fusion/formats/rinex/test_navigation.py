"""Navigation files: versions, Galileo's two messages, health, damage, and what RTKLIB reads of the same files."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fusion.errors import EmptyLogError, LogError
from fusion.formats.rinex.log import RinexFormat
from fusion.signals import BEIDOU, GALILEO, GLONASS, GPS, QZSS, Navigation
from fusion.simulate.write import rinex_file
from fusion.types import DriveLog, no_progress
from gnss_tables import agree, some_navigation


def read(text: str) -> DriveLog:
    """The log of a text."""
    return RinexFormat().read_part(text.encode(), no_progress, Navigation())


def navigation_of(log: DriveLog) -> Navigation:
    """Its ephemerides."""
    assert log.raw is not None
    return log.raw.navigation


def split(text: str) -> tuple[list[str], list[list[str]]]:
    """The header's lines, and the lines of each record."""
    lines = text.splitlines()
    end = next(i for i, line in enumerate(lines) if "END OF HEADER" in line) + 1
    records: list[list[str]] = []
    for line in lines[end:]:
        if line[0] != " ":
            records.append([])
        records[-1].append(line)
    return lines[:end], records


def of_system(system: int) -> Navigation:
    """Ephemerides of one system alone."""
    data = some_navigation(5)
    return replace(data, kepler=replace(data.kepler, system=np.full(20, system), healthy=np.ones(20, bool)))


def as_version_2(data: Navigation, system: int) -> str:
    """The records of a system as version 2.11 writes them."""
    _, records = split(rinex_file.navigation(data))
    letter = "GREC"[system]
    kind = {GPS: "NAVIGATION DATA", GLONASS: "GLONASS NAV DATA"}[system]
    out = [f"{'     2.11':20}{kind:40}RINEX VERSION / TYPE"]
    if system == GPS:
        alpha = "".join(f"{v:12.4E}" for v in (data.klobuchar or ())[:4]).replace("E", "D")
        beta = "".join(f"{v:12.4E}" for v in (data.klobuchar or ())[4:]).replace("E", "D")
        out += [f"{'  ' + alpha:60}ION ALPHA", f"{'  ' + beta:60}ION BETA"]
    out += [f"{'':60}END OF HEADER"]
    for record in records:
        if record[0][0] == letter:
            first = record[0]
            clock = (
                f"{int(first[1:3]):2} {first[6:8]} {first[9:11]} {first[12:14]} {first[15:17]} {first[18:20]}"
            )
            out.append(f"{clock} {first[21:23]}.0{first[23:]}".replace("E", "D"))
            out += ["   " + line[4:].replace("E", "D") for line in record[1:]]
    return "\n".join(out) + "\n"


@pytest.mark.parametrize("system", [GPS, GLONASS])
def test_version_2_says_the_same_as_version_3(system: int) -> None:
    data = of_system(GPS)
    back = read(as_version_2(data, system))
    assert not back.skipped
    found = navigation_of(back)
    assert agree(found.kepler, data.kepler) if system == GPS else agree(found.glonass, data.glonass)
    assert len(found) == 20
    assert (found.klobuchar == pytest.approx(data.klobuchar)) if system == GPS else found.klobuchar is None


def test_version_4_has_records_under_lines_of_their_own() -> None:
    data = some_navigation(7)
    header, records = split(rinex_file.navigation(replace(data, klobuchar=None)))
    kinds = {"G": "LNAV", "R": "FDMA", "E": "INAV", "C": "D1", "J": "LNAV"}
    lines = [header[0].replace("3.04", "4.00"), *header[1:]]
    lines += [
        "> STO G01 LNAV",
        "    2023 11 07 00 00 00 GPUT                                  UTC(USNO)",
        "    0.0",
    ]
    lines += ["> ION G01 LNAV"]
    cells = [f"{v:19.12E}" for v in (*data.klobuchar, 0.0)]  # type: ignore[misc]
    lines += [
        "    2023 11 07 00 00 00" + "".join(cells[:3]),
        "    " + "".join(cells[3:7]),
        "    " + "".join(cells[7:]),
    ]
    for record in records:
        lines += [f"> EPH {record[0][:3]} {kinds[record[0][0]]}", *record]
    lines += [f"> EPH {records[0][0][:3]} CNV1", *records[0]]
    lines += [
        "> EOP G01 LNAV",
        "    2023 11 07 00 00 00" + cells[0] * 3,
        "    " + cells[0] * 3,
        "    " + cells[0] * 3,
    ]
    log = read("\n".join(lines))
    back = navigation_of(log)
    assert agree(back.kepler, data.kepler)
    assert agree(back.glonass, data.glonass)
    assert back.klobuchar == pytest.approx(data.klobuchar)
    assert dict(log.skipped) == {"records of a kind that is not read (CNAV and the like)": 1}


def changed(text: str, line: int, place: int, value: float) -> str:
    """A number of every record changed; ``line`` and ``place`` count from 0."""
    header, records = split(text)
    for record in records:
        at = 4 + 19 * place
        record[line] = f"{record[line]:80}"
        record[line] = record[line][:at] + f"{value:19.12E}" + record[line][at + 19 :]
    return "\n".join([*header, *(line for record in records for line in record)])


@pytest.mark.parametrize(
    ("system", "health", "usable"),
    [(GPS, 0, True), (GPS, 32, False), (BEIDOU, 1, False), (QZSS, 1, True), (QZSS, 2, False),
     (GALILEO, 0, True), (GALILEO, 1, False), (GALILEO, 0b010, False), (GALILEO, 0b111 << 6, True)],
)  # fmt: skip
def test_health_is_that_of_the_l1_band(system: int, health: int, usable: bool) -> None:
    data = replace(of_system(system), glonass=Navigation().glonass)
    found = navigation_of(read(changed(rinex_file.navigation(data), 6, 1, health)))
    assert found.kepler.healthy.tolist() == [usable] * 20


def test_galileo_takes_the_group_delay_of_its_clock_and_inav_before_fnav() -> None:
    data = replace(of_system(GALILEO), glonass=Navigation().glonass)
    inav = changed(rinex_file.navigation(data), 6, 2, 7e-9)
    fnav = changed(inav, 5, 1, 258)
    assert agree(navigation_of(read(inav)).kepler, data.kepler)
    assert navigation_of(read(fnav)).kepler.group_delay_s.tolist() == [7e-9] * 20
    header, records = split(fnav)
    both = "\n".join([inav, *(line for record in records for line in record)])
    assert agree(navigation_of(read(both)).kepler, data.kepler)
    later = changed(fnav, 3, 0, 1000.0)
    assert len(navigation_of(read("\n".join([inav, *later.splitlines()[len(header) :]]))).kepler) == 40


def test_weeks_go_by_the_calendar_whatever_number_is_stated() -> None:
    data = replace(some_navigation(9), glonass=Navigation().glonass)
    back = navigation_of(read(changed(rinex_file.navigation(data), 5, 2, 12.0)))
    assert agree(back.kepler, data.kepler)
    # a toe just after the week's end, with a clock reference just before
    edge = 2000 * 604800.0
    toe, toc, sent = (np.full(20, edge + late) for late in (16, -32, -90))
    late = replace(data.kepler, toe_s=toe, toc_s=toc, sent_s=sent)
    back = navigation_of(read(rinex_file.navigation(Navigation(late))))
    assert agree(back.kepler, late)


def test_damaged_records_are_counted_and_the_others_read() -> None:
    data = some_navigation(3)
    header, records = split(rinex_file.navigation(data))
    records[0] = records[0][:4]
    records[1][2] = records[1][2][:30]
    records[2][0] = "G99 2023 99" + records[2][0][11:]
    records[3][2] = records[3][2][:61] + f"{12.0:19.12E}"
    records[-1] = records[-1][:2]
    records[-2][1] = records[-2][1][:4] + f"{1.0:19.12E}" + records[-2][1][23:]
    records.append(
        ["I02 2023 11 07 00 00 00" + " 0.000000000000E+00" * 3, *["    " + " 0.000000000000E+00" * 4] * 7]
    )
    log = read("\n".join([*header, *(line for record in records for line in record)]))
    assert len(navigation_of(log)) == 34
    assert dict(log.skipped) == {
        "navigation records with lines missing": 2,
        "navigation records with numbers that cannot be": 3,
        "navigation records without satellite or time": 1,
        "navigation records of systems that are not read": 1,
    }


def test_blank_group_delays_count_as_nought() -> None:
    header, records = split(rinex_file.navigation(replace(of_system(GPS), glonass=Navigation().glonass)))
    for record in records:
        record[6] = record[6][:42]
    log = read("\n".join([*header, *(line for record in records for line in record)]))
    assert log.repaired["group delays left blank, taken as 0"] == 20


def test_cut_off_anywhere_it_gives_whole_records_or_says_why_not() -> None:
    data = some_navigation(2, 4)
    text = rinex_file.navigation(data)
    for cut in range(0, len(text), 41):
        try:
            found = navigation_of(read(text[:cut]))
        except LogError as error:
            assert str(error).endswith(".")
            continue
        assert set(found.kepler.af0_s) <= set(navigation_of(read(text)).kepler.af0_s)


def test_navigation_alone_belongs_to_observations() -> None:
    with pytest.raises(EmptyLogError, match="belongs to a file of observations"):
        RinexFormat().read(rinex_file.navigation(some_navigation(1)).encode(), no_progress)
    with pytest.raises(EmptyLogError, match="no usable ephemeris"):
        read(rinex_file.navigation(Navigation()))


@pytest.mark.parametrize(
    "name", ["BRDC00WRD_S_20230730000_01D_MN.rnx", "brdc1180.21n", "brdc1370.20n", "brdc1370.20g"]
)
def test_real_files_hold_what_rtklib_reads(shared_data: Path, name: str) -> None:
    rtklib = pytest.importorskip("pyrtklib")
    path = shared_data / "gnss" / name
    table, number = rtklib.nav_t(), rtklib.Arr1Dint(1)
    assert rtklib.readrnx(str(path), 1, "", rtklib.obs_t(), table, rtklib.sta_t()) == 1
    systems = {rtklib.SYS_GPS: GPS, rtklib.SYS_GAL: GALILEO, rtklib.SYS_CMP: BEIDOU, rtklib.SYS_QZS: QZSS}
    theirs = {}
    for k in range(table.n):
        e = table.eph[k]
        system = systems[rtklib.satsys(e.sat, number)]
        fnav = system == GALILEO and not e.code & 512
        delay = e.tgd[1] if system == GALILEO and not fnav else e.tgd[0]
        key = (system, number[0] - (192 if system == QZSS else 0), round(e.toe.time + e.toe.sec) - 315964800)
        if fnav and key in theirs:
            continue
        theirs[key] = (
            e.toc.time + e.toc.sec - 315964800, np.sqrt(e.A), e.e, e.M0, e.deln, e.OMG0, e.omg, e.OMGd, e.i0, e.idot,
            e.cuc, e.cus, e.crc, e.crs, e.cic, e.cis, e.f0, e.f1, e.f2, delay, float(e.iode),
        )  # fmt: skip
    kepler = navigation_of(RinexFormat().read_part(path.read_bytes(), no_progress, Navigation())).kepler
    names = ("toc_s", "root_a", "eccentricity", "m0_rad", "delta_n_radps", "omega0_rad", "omega_rad", "omega_dot_radps",
             "i0_rad", "i_dot_radps", "cuc_rad", "cus_rad", "crc_m", "crs_m", "cic_rad", "cis_rad", "af0_s", "af1",
             "af2_per_s", "group_delay_s", "issue")  # fmt: skip
    ours = {
        (int(kepler.system[k]), int(kepler.number[k]), round(kepler.toe_s[k])): tuple(
            float(getattr(kepler, n)[k]) for n in names
        )
        for k in range(len(kepler))
    }
    assert set(ours) == set(theirs)
    for key, values in ours.items():
        assert values == pytest.approx(theirs[key], rel=1e-13, abs=0), key


@pytest.mark.parametrize("name", ["BRDC00WRD_S_20230730000_01D_MN.rnx", "brdc1370.20g"])
def test_real_glonass_states_are_those_of_rtklib(shared_data: Path, name: str) -> None:
    rtklib = pytest.importorskip("pyrtklib")
    path = shared_data / "gnss" / name
    table, number = rtklib.nav_t(), rtklib.Arr1Dint(1)
    assert rtklib.readrnx(str(path), 1, "", rtklib.obs_t(), table, rtklib.sta_t()) == 1
    theirs = {}
    for k in range(table.ng):
        g = table.geph[k]
        rtklib.satsys(g.sat, number)
        theirs[number[0], round(g.toe.time + g.toe.sec) - 315964800] = (
            *(g.pos[i] for i in range(3)), *(g.vel[i] for i in range(3)), *(g.acc[i] for i in range(3)),
            -g.taun, g.gamn, g.frq, g.svh == 0,
        )  # fmt: skip
    found = navigation_of(RinexFormat().read_part(path.read_bytes(), no_progress, Navigation())).glonass
    # RTKLIB takes times from the file for UTC, and to the quarter of an hour
    ours = {
        (int(found.number[k]), round(found.toe_s[k])): (
            *found.position_m[k], *found.velocity_mps[k], *found.acceleration_mps2[k], found.clock_s[k],
            found.clock_rate[k], found.channel[k], found.healthy[k],
        )
        for k in range(len(found))
    }  # fmt: skip
    assert set(ours) == set(theirs)
    assert all(ours[key] == pytest.approx(theirs[key], rel=1e-13) for key in ours)
