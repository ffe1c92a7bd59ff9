"""GPX."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from fusion.errors import EmptyLogError, MalformedLogError
from fusion.formats import read_log


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


def test_tracks_and_segments_are_gaps(make: SimpleNamespace) -> None:
    assert len(read_log(make.gpx(segments=1)).gaps_s) == 0
    assert read_log(make.gpx(segments=3)).gaps_s - make.start_s == pytest.approx([100, 200])
    two_tracks = make.gpx(segments=2).replace(b"</trkseg>\n<trkseg>", b"</trkseg></trk>\n<trk><trkseg>")
    assert read_log(two_tracks).gaps_s - make.start_s == pytest.approx([100])


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
