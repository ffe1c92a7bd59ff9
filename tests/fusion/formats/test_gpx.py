"""GPX."""

from __future__ import annotations

import time
import tracemalloc
from types import SimpleNamespace

import gpxpy
import numpy as np
import pytest

from fusion.errors import EmptyLogError, MalformedLogError
from fusion.formats import read_log
from fusion.formats.xml_points import CHUNK_BYTES
from log_support import same


@pytest.mark.parametrize("version", ["1.0", "1.1"])
def test_points_heights_and_times_of_both_versions(make: SimpleNamespace, version: str) -> None:
    log = read_log(
        make.gpx(version=version, inner="<speed>10</speed><course>90</course><geoidheight>48</geoidheight>")
    )
    assert log.fix.time_s[:3] - make.start_s == pytest.approx([0, 1, 2])
    assert log.fix.lat_deg[1] == pytest.approx(50.95006)
    assert log.fix.alt_msl_m[:2] == pytest.approx([112, 112.1])
    assert log.fix.height_ell_m[0] == pytest.approx(160)
    assert log.velocity.vel_e_mps == pytest.approx(np.full(40, 10.0))
    assert log.velocity.vel_n_mps == pytest.approx(np.zeros(40), abs=1e-9)
    assert np.isnan(log.velocity.vel_d_mps).all()


def test_speed_within_extensions_and_prefixed_namespaces() -> None:
    log = read_log(
        b'<?xml version="1.0"?><g:gpx xmlns:g="http://www.topografix.com/GPX/1/1" xmlns:t="urn:t">'
        b"<g:trk><g:trkseg>"
        b'<g:trkpt lat="49" lon="8"><g:time>2018-05-04T17:34:20.250+02:00</g:time><g:extensions>'
        b"<t:Ext><t:speed>3</t:speed><t:course>0</t:course></t:Ext></g:extensions></g:trkpt></g:trkseg></g:trk></g:gpx>"
    )
    assert log.fix.time_s.tolist() == [1525448060.25]
    assert log.velocity.vel_n_mps.tolist() == [3]


def test_speed_without_a_course_is_the_vehicles_own(make: SimpleNamespace) -> None:
    osmand = "<extensions><osmand:speed>7.5</osmand:speed><osmand:heading>12</osmand:heading></extensions>"
    log = read_log(make.gpx(inner=osmand))  # the prefix is not declared
    assert log.odometry.speed_mps.tolist() == [7.5] * 40
    assert len(log.velocity) == 0
    still = make.gpx(inner="<speed>0</speed>")
    assert read_log(still).velocity.vel_n_mps.tolist() == [0] * 40
    unknown = make.gpx(inner="<extensions><speed>-1</speed><course>-1</course></extensions>")
    assert len(read_log(unknown).velocity) == len(read_log(unknown).odometry) == 0


@pytest.mark.parametrize("name", ["course", "cog", "bearing"])
def test_courses_by_their_names(make: SimpleNamespace, name: str) -> None:
    inner = (
        "<extensions><g:TrackPointExtension><g:atemp>20</g:atemp><g:speed>10</g:speed>"
        f"<g:{name}>90</g:{name}></g:TrackPointExtension></extensions>"
    )
    log = read_log(make.gpx(inner=inner))
    assert log.velocity.vel_e_mps == pytest.approx(np.full(40, 10.0))
    assert len(log.odometry) == len(log.pressure) == 0


def test_accuracies_in_metres_count_and_dilutions_do_not(make: SimpleNamespace) -> None:
    diluted = make.gpx(inner="<hdop>3.9</hdop><vdop>2</vdop><pdop>4</pdop>")
    assert {"fix.h_acc_m", "fix.v_acc_m"} <= set(read_log(diluted).missing)
    for creator in (b"OsmAnd~ 4.7.10", b"OsmAndRouterV2", b"Locus Map, Android"):
        log = read_log(diluted.replace(b"<gpx version", b'<gpx creator="' + creator + b'" version'))
        assert log.fix.h_acc_m.tolist() == [3.9] * 40
        assert "fix.v_acc_m" in log.missing
    for inner in (
        "<extensions><speed>7</speed><course>9</course><hAcc>2.5</hAcc><vAcc>3.5</vAcc></extensions>",
        "<extensions><t:hacc>2.5</t:hacc><t:vacc>3.5</t:vacc></extensions>",
        "<extensions><o:accuracy_horizontal>2.5</o:accuracy_horizontal><o:accuracy_vertical>3.5</o:accuracy_vertical>"
        "</extensions>",
    ):
        log = read_log(make.gpx(inner=inner))
        assert (log.fix.h_acc_m[0], log.fix.v_acc_m[0]) == (2.5, 3.5)
    assert "fix.h_acc_m" in read_log(make.gpx(inner="<extensions><hAcc>0</hAcc></extensions>")).missing


def test_what_stands_beside_the_points_is_not_taken_for_theirs(make: SimpleNamespace) -> None:
    sample = make.gpx(segments=1).replace(
        b"</trk>",
        b'</trk><rte><rtept lat="1" lon="2"><ele>5</ele></rtept></rte><extensions><speed>99</speed></extensions>',
    )
    sample = sample.replace(b"<trk>", b"<metadata><time>2001-01-01T00:00:00Z</time></metadata><trk>", 1)
    log = read_log(sample)
    assert log.fix.time_s - make.start_s == pytest.approx(np.arange(20.0))
    assert log.fix.alt_msl_m == pytest.approx(112 + np.arange(20) / 10)
    assert len(log.odometry) == 0


def test_it_reads_what_gpxpy_reads(make: SimpleNamespace) -> None:
    sample = make.gpx(version="1.0", inner="<speed>10</speed><course>80</course>")
    points = [p for p, *_ in gpxpy.parse(sample.decode()).walk()]
    log = read_log(sample)
    assert log.fix.time_s.tolist() == [p.time.timestamp() for p in points]
    assert log.fix.lat_deg.tolist() == [p.latitude for p in points]
    assert log.fix.lon_deg.tolist() == [p.longitude for p in points]
    assert log.fix.alt_msl_m.tolist() == [p.elevation for p in points]
    assert np.hypot(log.velocity.vel_n_mps, log.velocity.vel_e_mps) == pytest.approx(
        [p.speed for p in points]
    )


def test_absurd_numbers_are_none(make: SimpleNamespace) -> None:
    sample = make.gpx(segments=1).replace(b"<ele>112.5</ele>", b"<ele>1e999</ele>")
    sample = sample.replace(b"<ele>112.6</ele>", b"<ele>" + b"9" * 5000 + b"</ele>")
    sample = sample.replace(b"<ele>112.7</ele>", b"<ele>high</ele>").replace(
        b'lat="50.9504800"', b'lat="nan"'
    )
    log = read_log(sample)
    assert len(log.fix) == 19 and log.skipped["incomplete position"] == 1
    assert np.flatnonzero(np.isnan(log.fix.alt_msl_m)).tolist() == [5, 6, 7]


def test_elements_within_each_other_without_end_are_refused(make: SimpleNamespace) -> None:
    for deep in (b"<a>" * 400_000, b"<ele>" * 400_000):
        begin = time.process_time()
        sample = make.gpx(segments=1)
        with pytest.raises(MalformedLogError, match="nested more than 100 deep"):
            read_log(sample.replace(b"<ele>", deep, 1))
        assert time.process_time() - begin < 2


def test_values_that_lie_across_the_pieces_in_which_it_is_read(make: SimpleNamespace) -> None:
    sample = make.gpx(segments=1)
    assert all(
        same(
            read_log(sample),
            read_log(sample.replace(b"<trk>", b"<trk><!--" + b"x" * (CHUNK_BYTES - at) + b"-->")),
        )
        for at in range(150, 400, 9)
    )


@pytest.mark.parametrize("encoding", ["utf-16", "latin-1", "windows-1252"])
def test_encodings_that_it_declares(make: SimpleNamespace, encoding: str) -> None:
    text = make.gpx().decode().replace('version="1.0"?', f'version="1.0" encoding="{encoding}"?')
    assert same(
        read_log(text.replace("<trk>", "<trk><name>Süd</name>").encode(encoding)), read_log(make.gpx())
    )


@pytest.mark.slow
def test_a_long_track_takes_little_time_and_memory(make: SimpleNamespace) -> None:
    point = make.gpx(points=1, segments=1).split(b"<trkseg>")[1].split(b"</trkseg>")[0]
    sample = make.gpx(points=0, segments=1).replace(b"<trkseg>", b"<trkseg>" + point * 50_000)
    begin = time.process_time()
    tracemalloc.start()
    read_log(sample)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert time.process_time() - begin < 10  # a second without the tracing
    assert peak < 16e6


def test_tracks_and_segments_are_gaps(make: SimpleNamespace) -> None:
    assert len(read_log(make.gpx(segments=1)).outages_s) == 0
    assert read_log(make.gpx(segments=3)).outages_s - make.start_s == pytest.approx([100, 200])
    two_tracks = make.gpx(segments=2).replace(b"</trkseg>\n<trkseg>", b"</trkseg></trk>\n<trk><trkseg>")
    assert read_log(two_tracks).outages_s - make.start_s == pytest.approx([100])


def test_without_any_time_or_track_the_reason_is_said(make: SimpleNamespace) -> None:
    timeless = make.gpx().replace(b"<time>", b"<tame>").replace(b"</time>", b"</tame>")
    with pytest.raises(EmptyLogError, match=r"None of the 40 track points .* has a time"):
        read_log(timeless)
    with pytest.raises(EmptyLogError, match="routes or waypoints"):
        read_log(b'<gpx><wpt lat="1" lon="2"/><rte><rtept lat="1" lon="2"/></rte></gpx>')
    with pytest.raises(EmptyLogError, match="track point 1: lat_deg is 91"):
        read_log(
            b'<gpx><trk><trkseg><trkpt lat="91" lon="8"><time>2018-05-04T15:34:20Z</time></trkpt></trkseg>'
            b"</trk></gpx>"
        )


def test_points_without_or_with_unreadable_time_are_counted(make: SimpleNamespace) -> None:
    sample = make.gpx(segments=1).replace(b"<time>2018-05-04T15:34:21Z</time>", b"")
    sample = sample.replace(b"2018-05-04T15:34:22Z", b"half past three")
    log = read_log(sample)
    assert len(log.fix) == 18
    assert log.skipped["without a time"] == 2
    assert log.skipped["times that cannot be read"] == 1
    assert any("point 3" in w and "half past three" in w for w in log.warnings)


def test_a_file_cut_short_is_read_up_to_the_cut(make: SimpleNamespace) -> None:
    sample = make.gpx()
    log = read_log(sample[: sample.index(b"2018-05-04T15:34:30Z")])
    assert len(log.fix) == 10
    assert any("broken" in w for w in log.warnings)
    with pytest.raises(MalformedLogError, match="broken at line"):
        read_log(sample[: sample.index(b"<ele>")])


def test_entity_bombs_and_external_entities_are_refused() -> None:
    laughs = b'<!DOCTYPE l [<!ENTITY a "ha">' + b"".join(
        b'<!ENTITY %c "%s">' % (98 + i, b"&%c;" % (97 + i) * 10) for i in range(9)
    )
    point = b'<trkpt lat="1" lon="2"><time>2018-05-04T15:34:20Z</time></trkpt>'
    for doctype in (
        laughs + b"]>",
        b'<!DOCTYPE x [<!ENTITY e SYSTEM "file:///etc/passwd">]>',
        b'<!DOCTYPE x [<!ENTITY % p SYSTEM "file:///etc/passwd"> %p;]>',
    ):
        name = b"<name>&j;</name>" if doctype.startswith(laughs) else b"<name>&e;</name>"
        with pytest.raises(MalformedLogError, match="entities"):
            read_log(doctype + b"<gpx><trk>" + name + b"<trkseg>" + point + b"</trkseg></trk></gpx>")
