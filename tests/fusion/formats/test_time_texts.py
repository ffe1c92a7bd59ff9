"""Times as programs write them."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta, timezone

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fusion.formats.time_texts import times_of

moments = st.integers(347_155_200, 4_070_908_800).map(
    lambda s: datetime.fromtimestamp(s, UTC).replace(tzinfo=None)
)
zones = st.integers(-11 * 4, 12 * 4).map(lambda quarters: timezone(timedelta(minutes=15 * quarters)))
DAYS = ("Mon", "Tue", "Wed", "Thu", "Fri", "Sat", "Sun")
MONTHS = ("Jan", "Feb", "Mar", "Apr", "May", "Jun", "Jul", "Aug", "Sep", "Oct", "Nov", "Dec")


@given(moments, zones)
def test_offsets_are_taken_off(naive: datetime, zone: timezone) -> None:
    when = naive.replace(tzinfo=zone)
    offset = when.strftime("%z")
    texts = [
        when.isoformat(),
        f"{DAYS[when.weekday()]} {MONTHS[when.month - 1]} {when:%d %H:%M:%S} GMT{offset[:3]}:{offset[3:]} {when.year}",
        f"{when.day}-{MONTHS[when.month - 1]}-{when:%Y %H:%M:%S.000} {offset}",
        f"{when:%Y/%m/%d %H:%M:%S}{offset}",
    ]
    found, bare = times_of(texts)
    assert found.tolist() == [when.timestamp()] * len(texts)
    assert not bare.any()


@given(moments)
def test_without_offset_they_are_utc_and_marked(naive: datetime) -> None:
    texts = [
        f"{naive:%Y-%m-%d %H:%M:%S}",
        f"{naive:%d.%m.%Y %H:%M:%S,250}",
        f"{naive.day}-{MONTHS[naive.month - 1]}-{naive:%Y %H:%M:%S}",
    ]
    found, bare = times_of(texts)
    at = naive.replace(tzinfo=UTC).timestamp()
    assert found.tolist() == [at, at + 0.25, at]
    assert bare.all()


@pytest.mark.parametrize(
    ("text", "hour"),
    [
        ("Mon Mar 05 10:11:12 CET 2018", 9), ("Mon Mar 05 10:11:12 PDT 2018", 17), ("Mo. Mär 05 10:11:12 MEZ 2018", 9),
        ("05-mars-2018 10:11:12", 10), ("05-Mrz-2018 10:11:12", 10), ("Mon Mar 05 10:11:12 XYZ 2018", 10),
    ],
)  # fmt: skip
def test_names_of_zones_and_months(text: str, hour: int) -> None:
    found, _ = times_of([text])
    assert found[0] == datetime(2018, 3, 5, hour, 11, 12, tzinfo=UTC).timestamp()


@pytest.mark.parametrize(
    "text",
    [
        "03/05/2018 10:11:12",
        "05-Mar-2018 25:11:12",
        "32-Mar-2018 10:11:12",
        "05-Foo-2018 10:11:12",
        "yesterday",
        "x" * 10000,
    ],
)
def test_what_is_uncertain_or_no_time_is_unknown(text: str) -> None:
    assert np.isnan(times_of([text])[0][0])


@pytest.mark.parametrize(("unit", "size"), [("s", 1), ("ms", 1e3), ("us", 1e6), ("ns", 1e9)])
@given(at=st.integers(315_532_800 + 86400, 4_102_444_800))
def test_numbers_are_in_the_unit_that_their_size_tells(unit: str, size: float, at: int) -> None:
    assert times_of([str(int(at * size)), None])[0][0] == pytest.approx(at, abs=1e-3)


def test_numbers_may_be_mixed_with_what_is_none() -> None:
    found, bare = times_of(["1525448060", "", None, "x"])
    assert found[0] == 1525448060
    assert np.isnan(found[1:]).all()
    assert not bare.any()


@pytest.mark.parametrize("put", ['"', "\0", "x", "²"])
def test_a_letter_in_an_offset_spoils_its_own_time_alone(put: str) -> None:
    sound = [f"Fri May 04 17:34:{second:02d} GMT+02:00 2018" for second in range(20)]
    spoiled = [*sound[:7], sound[7].replace("+02:00", f"+02:0{put}"), *sound[8:]]
    found, expected = times_of(spoiled)[0], times_of(sound)[0]
    assert np.isnan(found[7])
    np.testing.assert_array_equal(np.delete(found, 7), np.delete(expected, 7))
