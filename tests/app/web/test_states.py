"""Each state of the pages, on a desk and on a phone, in the light and in the dark, in each language.

`PICTURES=folder` keeps a picture of each, for people to look at.
"""

from __future__ import annotations

import itertools
import os
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from app.core import databases
from app.core.settings import Settings
from app.embedded.cluster import EmbeddedPostgres
from browser_fixtures import Tab
from fusion.simulate.scene.town import Town
from page_states import dashboard_states, drive_states, first_states, map_states, services
from page_states.rules import broken, of_another_language
from page_states.table import COMBINATIONS, STATES, Combination, Look, Service, usual
from web_fixtures import served

MODULES = (dashboard_states, drive_states, first_states, map_states)
"""What is loaded so that it puts its states into the table."""
WHY_LONG = (
    "two seconds for each of the states in combinations beyond two that have every size, theme and language"
)


@pytest.fixture(scope="module")
def service(
    cluster: EmbeddedPostgres,
    template_db: str,
    new_database: Callable[[str], str],
    tmp_path_factory: pytest.TempPathFactory,
    town: Town,
    files: Path,
    request: pytest.FixtureRequest,
) -> Iterator[Service]:
    """The service of this name, for all its states."""
    name, folder = new_database(template_db), tmp_path_factory.mktemp("states")
    settings = Settings(
        database_url=cluster.url_of(name), data_dir=folder, max_upload_bytes=200_000, default_method="raw"
    )
    with served(settings) as web:
        fill = {
            "grid": lambda: services.grid(web, folder),
            "town": lambda: services.town(web, folder, town),
            "bare": lambda: services.bare(web, (files / "0.csv").read_bytes()),
        }[request.param]
        with fill() as filled:
            yield filled
    databases.drop_database(cluster.url, name)


def tried() -> Iterator[object]:
    """Each state in the usual combinations and, where there is time, in all."""
    for number, (name, one) in enumerate(STATES.items()):
        for how in COMBINATIONS:
            marks = () if how in usual(number) else (pytest.mark.long(WHY_LONG),)
            yield pytest.param(name, one.service, how, id=f"{name}-{how.name}", marks=marks)


@pytest.mark.parametrize(("name", "service", "how"), [*tried()], indirect=["service"])
def test_a_state_is_as_it_should_be(
    service: Service, tab_maker: Callable[..., Tab], name: str, how: Combination
) -> None:
    tab = tab_maker(**how.options)
    tab.expected.append("GPU stall due to ReadPixels")
    STATES[name].bring(Look(tab, service, how))
    if folder := os.environ.get("PICTURES"):
        number = STATES[name].number.replace("/", "+")
        tab.page.screenshot(path=f"{folder}/{number}-{name}-{how.name}.png", full_page=True)
    found = broken(tab, how)
    assert not found, "\n".join(f"{rule}: {one}" for rule, where in found.items() for one in where)


def test_each_state_has_every_size_theme_and_language_and_all_states_every_combination() -> None:
    tried_in = [usual(number) for number in range(len(STATES))]
    for first, second in tried_in:
        assert all(getattr(first, part) != getattr(second, part) for part in ("size", "theme", "language"))
    assert set(itertools.chain(*tried_in)) == set(COMBINATIONS)


def test_every_number_that_a_page_shows_has_a_state() -> None:
    numbers = {part for one in STATES.values() for part in one.number.split("/")}
    # 9 is of the command line.
    assert numbers == {"1", "2", "3", "4", "5", "6", "7", "8", "10", "11", "12", "13", "14", "15"}


@pytest.mark.parametrize("written", ["Waits for roads", "The line of ride.gpx."])
def test_a_text_of_another_language_would_be_seen(written: str) -> None:
    assert of_another_language([written], "de") == [written]
    assert of_another_language([written], "en") == []
