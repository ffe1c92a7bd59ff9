"""Fixtures for every test: a private PostGIS with one database per test, shared data, the synthetic town.

The whole run uses one server that is made for it and one template database that is migrated once; a test that
asks for ``database_url`` gets a fresh copy of the template, or of one with roads, which takes tens of milliseconds.
"""

from __future__ import annotations

import contextlib
import gc
import importlib.util
import io
import itertools
import logging
import os
import shutil
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING

import psycopg
import pytest
from hypothesis import settings as hypothesis_settings
from psycopg import sql

from app.core import databases, migrate
from app.core.settings import ENV_PREFIX, get_settings
from app.core.settings.places import libpq_url
from app.core.telemetry.logs import CHATTY, JsonLines, TextLines
from app.embedded.cluster import EmbeddedPostgres
from app.embedded.errors import PostgresMissingError
from changed_tests import ALWAYS

if TYPE_CHECKING:
    from fusion.simulate.scene.town import Town

REPOSITORY = Path(__file__).resolve().parents[1]
TEMPLATE = "template_versant"
FILLED = ("grid_database", "town_database")
"""Fixtures that name a database with roads, made once: of a test that asks for one ``database_url`` is a copy."""
MEMORY = Path("/dev/shm")  # noqa: S108  (a file system in memory; what is made there has a name of its own)
ROOM_BYTES = 4 * 2**30
"""As much may the servers of a run need, one for each of its processes, with their logs."""

FIRST_TEST_S = pytest.StashKey[float]()

# Waiting threads of compiled loops sleep instead of spinning, as the command line sets it.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")

# Compiled loops take seconds at their first call, and machines are shared: no test depends on time.
# Examples of each property: `make check` tries a few, `make test` more, `make test-all` the most.
hypothesis_settings.register_profile("quick", deadline=None, max_examples=20)
hypothesis_settings.register_profile("usual", deadline=None, max_examples=30)
hypothesis_settings.register_profile("thorough", deadline=None, max_examples=200)
hypothesis_settings.load_profile("usual")


def pytest_addoption(parser: pytest.Parser) -> None:
    """``--seconds 35``: for a look at what changed, of which there may be much."""
    help_text = "after so long begin no test but those of layout and contracts, and say how many are left"
    parser.addoption("--seconds", type=float, help=help_text)


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Skip what does not begin within ``--seconds`` of the first test."""
    begin_s = item.config.stash.setdefault(FIRST_TEST_S, time.monotonic())
    most_s = item.config.getoption("--seconds")
    in_time = most_s is None or time.monotonic() - begin_s <= most_s
    if not in_time and item.path.relative_to(REPOSITORY).as_posix() not in ALWAYS:
        pytest.skip(f"not begun within {most_s:g} s: `make test` runs it")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Every test that reaches the server, through whatever fixture, is marked ``db``; a ``long`` one says why."""
    for item in items:
        if "cluster" in getattr(item, "fixturenames", ()):
            item.add_marker(pytest.mark.db)
        if any(not mark.args for mark in item.iter_markers("long")):
            raise pytest.UsageError(f"{item.nodeid} is marked as long without a reason.")


def pytest_collection_finish() -> None:
    """What is loaded now stays to the end: the collector need not look at these millions of objects again."""
    gc.collect()
    gc.freeze()


@pytest.fixture(scope="session", autouse=True)
def environment_of_nobody() -> Iterator[None]:
    """Tests see no setting of the person who runs them, and no test reaches that person's data folder.

    Services of tests ask for no keys, but for those that are about keys, which say ``access="keys"``.
    """
    with pytest.MonkeyPatch.context() as patch, tempfile.TemporaryDirectory() as home:
        for name in [n for n in os.environ if n.startswith(ENV_PREFIX)]:
            patch.delenv(name)
        patch.setenv("XDG_DATA_HOME", home)
        patch.setenv("XDG_STATE_HOME", home)
        patch.setenv("VERSANT_ACCESS", "open")
        patch.setenv("VERSANT_OPEN_TO_NETWORK", "true")
        get_settings.cache_clear()
        yield
        get_settings.cache_clear()


@pytest.fixture(scope="module", autouse=True)
def turn_of_one_s_own() -> Iterator[None]:
    """A command that lets others go first must not hold up the tests after it, where the process may take that back."""
    usual = os.nice(0)
    yield
    if os.nice(0) != usual:
        with contextlib.suppress(PermissionError):
            os.setpriority(os.PRIO_PROCESS, 0, usual)


@pytest.fixture(autouse=True)
def log_of_one_s_own() -> Iterator[None]:
    """A command that logs, as a process of its own would, leaves nothing of that to the tests after it."""
    root = logging.getLogger()
    level, handlers = root.level, list(root.handlers)
    yield
    root.setLevel(level)
    for handler in [one for one in root.handlers if one not in handlers]:
        if isinstance(handler.formatter, TextLines | JsonLines):
            root.removeHandler(handler)
    logging.captureWarnings(capture=False)
    for chatty in CHATTY:
        logging.getLogger(chatty).setLevel(logging.NOTSET)


def place_of_servers() -> Path | None:
    """Where to keep the server: in memory where there is room; None: where temporary files are.

    A database is a thousand files. On ext4, which passes over inodes that were just deleted one by one, making and
    dropping one database after another costs ten times as much.
    """
    with contextlib.suppress(OSError):
        if shutil.disk_usage(MEMORY).free >= ROOM_BYTES and os.access(MEMORY, os.W_OK):
            return MEMORY
    return None


@pytest.fixture(scope="session")
def cluster() -> Iterator[EmbeddedPostgres]:
    """The run's own PostGIS server. Without PostgreSQL the tests fail and say what to install."""
    with tempfile.TemporaryDirectory(prefix="versant-test-", dir=place_of_servers()) as folder:
        server = EmbeddedPostgres(Path(folder), durable=False)
        try:
            server.start()
        except PostgresMissingError as error:
            pytest.fail(f"{error} `make setup` does it on Debian.", pytrace=False)
        yield server
        server.stop()


@pytest.fixture(scope="session")
def template_db(cluster: EmbeddedPostgres) -> str:
    """Name of a migrated database that nobody is connected to."""
    databases.ensure_database(cluster.url, TEMPLATE)
    migrate.upgrade(cluster.url_of(TEMPLATE))
    return TEMPLATE


@pytest.fixture(scope="session")
def server(cluster: EmbeddedPostgres) -> Iterator[psycopg.Connection]:
    """The one connection by which databases are made and dropped: a new one each time is a process each time."""
    with psycopg.connect(libpq_url(cluster.url), autocommit=True) as connection:
        yield connection


@pytest.fixture(scope="session")
def new_database(server: psycopg.Connection) -> Callable[[str], str]:
    """``new_database(template)`` makes a copy of a database and returns its name."""
    numbers = itertools.count(1)

    # Copying files takes half the time of copying through the server's log.
    copy = sql.SQL("CREATE DATABASE {} TEMPLATE {} STRATEGY file_copy")

    def create(template: str) -> str:
        name = f"test_{next(numbers)}"
        server.execute(copy.format(sql.Identifier(name), sql.Identifier(template)))
        return name

    return create


@pytest.fixture
def database_url(
    cluster: EmbeddedPostgres,
    server: psycopg.Connection,
    template_db: str,
    new_database: Callable[[str], str],
    request: pytest.FixtureRequest,
) -> Iterator[str]:
    """SQLAlchemy URL of a migrated database of this test alone: empty, or a copy of one that its fixtures ask for."""
    filled = [name for name in FILLED if name in request.fixturenames]
    assert len(filled) < 2, "a database is a copy of one other"
    name = new_database(request.getfixturevalue(filled[0]) if filled else template_db)
    yield cluster.url_of(name)
    server.execute(sql.SQL("DROP DATABASE IF EXISTS {} WITH (FORCE)").format(sql.Identifier(name)))


@pytest.fixture
def blank_database_url(cluster: EmbeddedPostgres, new_database: Callable[[str], str]) -> Iterator[str]:
    """SQLAlchemy URL of a database without any table or extension, for tests of the migrations."""
    name = new_database("template0")
    yield cluster.url_of(name)
    databases.drop_database(cluster.url, name)


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Folder of the recorded data that lies beside the repository and is no part of it."""
    folder = REPOSITORY.parent / "shared" / "data"
    if not folder.is_dir():
        pytest.skip("the recorded data (../shared/data beside the repository) is not on this machine")
    return folder


@pytest.fixture(scope="session")
def town() -> Town:
    """The synthetic town of seed 1, with its true slopes."""
    from fusion.simulate.scene.town import make_town  # noqa: PLC0415 - only the tests that use it pay for it

    return make_town(seed=1)


@pytest.fixture(scope="session")
def karlsruhe(shared_data: Path) -> Path:
    """Folder of the reference drives around Karlsruhe."""
    folder = shared_data / "karlsruhe"
    if not folder.is_dir():
        pytest.skip("the recorded data ../shared/data/karlsruhe is not on this machine")
    return folder


@pytest.fixture(scope="session")
def receiver_log(karlsruhe: Path) -> Callable[..., Path]:
    """``receiver_log(name, path, seed=0, profile="m8", cut=None, rate=1.0)``: a log along a reference drive, a CSV."""
    tool = karlsruhe.parents[1] / "tools" / "roadtruth.py"
    if not tool.exists():
        pytest.skip("roadtruth.py (../shared/tools) is not on this machine")
    spec = importlib.util.spec_from_file_location("roadtruth", tool)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)

    def make(
        name: str,
        path: Path,
        seed: int = 0,
        profile: str = "m8",
        cut: list[str] | None = None,
        rate: float = 1.0,
    ) -> Path:
        reference = str(karlsruhe / f"ref_{name}.csv")
        wanted = SimpleNamespace(ref=reference, out=str(path), seed=seed, rate=rate, profile=profile, cut=cut)
        with contextlib.redirect_stdout(io.StringIO()):
            module.drive(wanted)
        return path

    return make
