"""Which files are one drive: the rule, case by case, and what holds of any files."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from fusion.formats.glance import Glance
from fusion.formats.grouping import CONTINUED_WITHIN_S, Grouping, Rule, Unclear, Why, grouped

DAY_S = 86400.0
AT_S = 1.7e9


def ride(first_s: float, last_s: float, lat: float = 49.0, lon: float = 8.4, kind: str = "gpx") -> Glance:
    """A log that drives north by 10 m/s."""
    time_s = np.linspace(first_s, last_s, 200)
    track = np.column_stack([time_s, lat + (time_s - first_s) * 9e-5, np.full(200, lon)])
    return Glance(kind, first_s, last_s, track)


def signals(first_s: float, last_s: float) -> Glance:
    return Glance("rinex", first_s, last_s, has_signals=True)


def navigation(first_s: float = np.nan, last_s: float = np.nan) -> Glance:
    return Glance("rinex", first_s, last_s, has_navigation=True)


def sensors(first_s: float, last_s: float) -> Glance:
    return Glance("csv", first_s, last_s)


def hours(first: float, last: float) -> tuple[float, float]:
    return AT_S + 3600 * first, AT_S + 3600 * last


def test_rides_whose_times_do_not_overlap_are_drives_of_their_own() -> None:
    rides = [ride(AT_S + k * DAY_S, AT_S + k * DAY_S + 3600) for k in range(30)]
    assert grouped(rides) == Grouping(tuple((k,) for k in range(30)))
    assert grouped([ride(*hours(0, 1)), ride(*hours(1.2, 2), lat=49.3)]).drives == ((0,), (1,))


def test_observations_take_navigation_and_sensors_along() -> None:
    files = [navigation(AT_S - DAY_S / 2, AT_S), signals(*hours(0, 1)), sensors(*hours(0.5, 1.5))]
    assert grouped(files).drives == ((0, 1, 2),)
    assert grouped([signals(*hours(0, 1)), navigation()]).drives == ((0, 1),)
    # As it was before files were looked at: a single drive takes all, also what does not fit.
    assert grouped([ride(*hours(0, 1)), sensors(*hours(5, 6)), navigation()]).drives == ((0, 1, 2),)


def test_two_days_of_observations_share_nothing_but_what_is_of_both() -> None:
    files = [
        signals(*hours(0, 1)),
        signals(*hours(72, 73)),
        navigation(*hours(-2, 2)),
        navigation(*hours(70, 74)),
        navigation(),
        sensors(*hours(-1, 100)),
        sensors(*hours(40, 41)),
    ]
    assert grouped(files) == Grouping(((0, 2, 4, 5), (1, 3, 4, 5)), left=(6,))


def test_navigation_beside_rides_alone_belongs_to_none() -> None:
    assert grouped([ride(*hours(0, 1)), ride(*hours(30, 31)), navigation()]).left == (2,)


def test_sensors_of_one_recording_are_one_drive_without_a_doubt() -> None:
    location, network = (
        replace(ride(*hours(0, 1), kind="sensor-logger"), is_of_several=True) for _ in range(2)
    )
    unused = Glance("sensor-logger", is_of_several=True)
    assert grouped([location, sensors(*hours(0, 1)), network, unused]) == Grouping(((0, 1, 2, 3),))
    assert grouped([location, ride(*hours(30, 31)), unused]) == Grouping(((0,), (1,)), left=(2,))


def test_a_recorder_that_begins_a_new_file_goes_on_with_its_drive_and_that_is_said() -> None:
    first = ride(AT_S, AT_S + 300)
    end = float(first.track[-1, 1])
    second = ride(AT_S + 302, AT_S + 602, lat=end)
    third = ride(AT_S + 604, AT_S + 700, lat=float(second.track[-1, 1]))
    assert grouped([third, first, second]) == Grouping(((0, 1, 2),), (), (Unclear((0, 1, 2), Why.CONTINUES),))
    assert grouped([third, first, second], Rule.APART) == Grouping(((0,), (1,), (2,)))
    apart = [
        ride(AT_S + 302, AT_S + 602, lat=end + 0.01),
        ride(AT_S + 302, AT_S + 602, lat=end, kind="fit"),
        ride(AT_S + 301 + CONTINUED_WITHIN_S, AT_S + 900, lat=end),
    ]
    for other in apart:
        assert grouped([first, other]).drives == ((0,), (1,))
    assert grouped([signals(AT_S, AT_S + 899), signals(AT_S + 900, AT_S + 1799)]).drives == ((0, 1),)


def test_positions_of_the_same_time_are_one_drive_only_where_they_are_together() -> None:
    one, other_device = ride(*hours(0, 1)), ride(*hours(0, 1), lat=49.0001, kind="fit")
    assert grouped([one, other_device]) == Grouping(((0, 1),), (), (Unclear((0, 1), Why.OVERLAPS),))
    assert grouped([one, other_device], Rule.APART).drives == ((0,), (1,))
    assert grouped([one, ride(*hours(0, 1), lat=50.0)]) == Grouping(((0,), (1,)))
    assert grouped([one, signals(*hours(0, 1))]) == Grouping(((0, 1),))
    across = [ride(*hours(0, 1), lon=lon) for lon in (179.9999, -179.9999)]
    assert grouped(across).drives == ((0, 1),)


def test_what_is_not_known_is_a_drive_of_its_own_and_all_may_be_said_to_be_one() -> None:
    unread, undated = Glance("csv", is_unread=True), Glance("nmea", track=np.ones((3, 3)))
    files = [ride(*hours(0, 1)), unread, ride(*hours(50, 51)), undated]
    assert grouped(files).drives == ((0,), (1,), (2,), (3,))
    assert grouped(files, Rule.ONE) == Grouping(((0, 1, 2, 3),))
    assert grouped([]).drives == ()
    assert grouped([navigation(), sensors(*hours(0, 1))]).drives == ((0, 1),)


MOMENTS = st.tuples(st.integers(0, 40), st.integers(1, 5)).map(
    lambda at: (AT_S + 400 * at[0], AT_S + 400 * sum(at))
)
FILES = st.lists(
    st.one_of(
        st.builds(lambda at, lat, kind: ride(at[0], at[1], lat, 8.4, kind), MOMENTS, st.sampled_from([49.0, 49.5]),
                  st.sampled_from(["gpx", "fit"])),
        MOMENTS.map(lambda at: signals(*at)),
        MOMENTS.map(lambda at: navigation(*at)),
        MOMENTS.map(lambda at: sensors(*at)),
        st.sampled_from([navigation(), Glance("csv"), Glance("csv", is_unread=True)]),
    ),
    min_size=1,
    max_size=8,
)  # fmt: skip


@given(FILES, st.sampled_from(list(Rule)))
def test_no_file_is_lost_and_what_makes_a_drive_is_in_one(files: list[Glance], rule: Rule) -> None:
    found = grouped(files, rule)
    times_in = [sum(k in drive for drive in found.drives) for k in range(len(files))]
    for k, file in enumerate(files):
        assert times_in[k] == 0 if k in found.left else times_in[k] >= 1
        if file.makes_a_drive:
            assert times_in[k] == 1
    assert all(any(set(one.files) <= set(drive) for drive in found.drives) for one in found.unclear)
    assert all(list(drive) == sorted(drive) for drive in found.drives)


@given(FILES, st.permutations(range(8)), st.sampled_from(list(Rule)))
def test_the_order_of_files_changes_nothing(files: list[Glance], order: list[int], rule: Rule) -> None:
    order = [k for k in order if k < len(files)]
    found, again = grouped(files, rule), grouped([files[k] for k in order], rule)
    assert {frozenset(d) for d in found.drives} == {frozenset(order[k] for k in d) for d in again.drives}
    assert set(found.left) == {order[k] for k in again.left}


@given(FILES)
def test_apart_only_divides(files: list[Glance]) -> None:
    def makers(rule: Rule) -> list[set[int]]:
        return [{k for k in drive if files[k].makes_a_drive} for drive in grouped(files, rule).drives]

    whole = makers(Rule.AUTO)
    assert all(any(part <= drive for drive in whole) for part in makers(Rule.APART))
    assert grouped(files, Rule.APART).unclear == ()
