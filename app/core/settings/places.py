"""Where the service keeps things, and for how long: the first part of its settings, and what URLs and folders are."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated
from urllib.parse import unquote

from pydantic import AfterValidator, Field
from pydantic_settings import BaseSettings, SettingsConfigDict

SQLALCHEMY_SCHEME = "postgresql+psycopg://"
LIBPQ_SCHEME = "postgresql://"
GIB = 2**30


@dataclass(frozen=True)
class RemoteFolder:
    """Files that never change, kept under an fsspec URL and read through copies in a folder (``app.core.mirror``)."""

    url: str
    copies: Path


FilePlace = Path | RemoteFolder
"""Where such files are: in a folder that every process reaches, or elsewhere."""


MOST_KEEP_DAYS = 36_500
"""A hundred years."""


def default_data_dir() -> Path:
    """``$XDG_DATA_HOME/versant``, or ``~/.local/share/versant`` where that variable is unset or relative."""
    return _own_folder("XDG_DATA_HOME", "share")


def default_state_dir() -> Path:
    """``$XDG_STATE_HOME/versant``, or ``~/.local/state/versant``: what commands know from one run to the next."""
    return _own_folder("XDG_STATE_HOME", "state")


def _own_folder(variable: str, usual: str) -> Path:
    base = Path(os.environ.get(variable, ""))
    # The XDG specification says that relative paths are to be ignored.
    return (base if base.is_absolute() else Path.home() / ".local" / usual) / "versant"


def sqlalchemy_url(url: str) -> str:
    """A PostgreSQL URL with the driver's name that SQLAlchemy wants; ValueError for another scheme."""
    scheme, separator, rest = url.partition("://")
    if not separator or scheme not in {"postgresql", "postgres", "postgresql+psycopg"}:
        raise ValueError("it must be a URL such as postgresql://user:password@host:5432/versant")
    return SQLALCHEMY_SCHEME + rest


def libpq_url(url: str) -> str:
    """The same URL without a driver's name, for psycopg, procrastinate and psql."""
    return LIBPQ_SCHEME + sqlalchemy_url(url).removeprefix(SQLALCHEMY_SCHEME)


def _absolute(path: Path) -> Path:
    # Child processes may run in another directory, so a relative folder is fixed where it was given.
    return path.expanduser().absolute()


class Places(BaseSettings):
    """What is kept where."""

    model_config = SettingsConfigDict(use_attribute_docstrings=True)

    # Not shown: it may hold a password.
    database_url: Annotated[str, AfterValidator(sqlalchemy_url)] | None = Field(
        None, repr=False
    )  # it may hold a password
    """PostgreSQL with PostGIS, as postgresql://user:password@host:port/name; unset: the embedded cluster in
    data_dir."""
    database_pooled: bool = False
    """Whether DATABASE_URL or DATABASE_READ_URL leads through a pooler in transaction mode, such as PgBouncer: then
    nothing is kept in a connection beyond a transaction."""
    database_direct_url: Annotated[str, AfterValidator(sqlalchemy_url)] | None = Field(None, repr=False)
    """The same database past the pooler, for what needs a connection for itself: hearing of jobs and changes,
    migrations, backups. Unset: DATABASE_URL; through a pooler jobs and changes are then looked for every second."""
    database_read_url: Annotated[str, AfterValidator(sqlalchemy_url)] | None = Field(None, repr=False)
    """A hot standby of the same database, one server, from which the API reads the map: tiles, items, heights. Unset:
    it reads everything from DATABASE_URL, as it does whenever the standby is away or too far behind."""
    database_read_lag_s: float = Field(5.0, ge=2, le=3600)
    """Seconds that the map which is read from DATABASE_READ_URL may be behind the database; what is farther behind is
    read from DATABASE_URL."""
    data_dir: Annotated[Path, AfterValidator(_absolute)] = Field(default_factory=default_data_dir)
    """Folder of the embedded cluster, of uploaded logs and of elevation rasters; default $XDG_DATA_HOME/versant or
    ~/.local/share/versant."""
    blob_url: str | None = None
    """Where logs are kept, an fsspec URL such as s3://bucket/logs; unset: data_dir/blobs."""
    dem_url: str | None = None
    """Where elevation rasters are kept, an fsspec URL such as s3://bucket/dem, with copies for reading in
    data_dir/dem-copies; unset: data_dir/dem."""
    min_free_bytes: int = Field(GIB // 4, ge=0)
    """Room that stays free where logs are kept, bytes: an upload that would take it is answered by 507, and /readyz by
    503 when there is less."""
    orphan_days: float = Field(7.0, ge=1)
    """Days after which a stored log without a drive, or an elevation raster in no use, is removed. Longer than the
    oldest backup of the database that may be restored, so that it finds its files."""
    keep_logs_days: int | None = Field(None, ge=0, le=MOST_KEEP_DAYS)
    """Days for which the log of a drive that is done or failed is kept, for owners that do not say it themselves; 0:
    until it is done, where it failed a day. Results stay; without its log a drive cannot be computed again when roads
    change. Unset: for good."""
    export_keep_days: float = Field(7.0, gt=0, le=365)
    """Days for which an export that is done is kept; asking again makes it anew."""
    exports_max_bytes: int = Field(20 * GIB, ge=0)
    """Room that all exports together may take where logs are kept, bytes; the oldest go first."""
    exports_owner_bytes: int = Field(5 * GIB, ge=0)
    """Room that the exports of one owner may take of that, bytes; its oldest go first. Those of operators may take
    all."""

    road_tolerance_m: float = Field(2.0, ge=0, le=20)
    """A road segment whose ends an import moves by no more, metres, keeps what was measured on it."""
    keep_dropped_days: float = Field(30.0, ge=0)
    """Days for which what was measured on roads that an import took away is kept; it comes back with its road."""

    changes_kept_days: float = Field(90.0, ge=1)
    """Days for which removed segments are told to who follows changes; older versions get a 410."""
    jobs_kept_days: float = Field(30.0, ge=1)
    """Days for which a job of the queue that failed or was cancelled is kept, for who looks into the database: drives
    and operations say themselves what became of them."""
    history_kept_days: float = Field(400.0, ge=31)
    """Days for which it is kept what was asked for and is over: operations, batches that no drive names any more, and
    what owners uploaded on each day."""

    @property
    def session_url(self) -> str | None:
        """The database for what needs a connection for itself, as far as there is one."""
        return self.database_direct_url or self.database_url

    @property
    def listen_url(self) -> str | None:
        """The database where announcements can be received; None: a pooler is in between."""
        return self.session_url if self.database_direct_url or not self.database_pooled else None

    @property
    def blob_store_url(self) -> str:
        """``blob_url``, or the ``file://`` URL of ``data_dir/blobs``."""
        return self.blob_url or (self.data_dir / "blobs").as_uri()

    @property
    def keeps_files_together(self) -> bool:
        """Whether logs and rasters are both in the data folder: who uses the ones uses the others."""
        return self.blob_url is None and self.dem_url is None

    @property
    def dem_dir(self) -> FilePlace:
        """Where imported elevation rasters are kept: ``dem_url``, or the folder ``data_dir/dem``."""
        if self.dem_url is None:
            return self.data_dir / "dem"
        if "://" in self.dem_url and not self.dem_url.startswith("file://"):
            return RemoteFolder(self.dem_url, self.data_dir / "dem-copies")
        return _absolute(Path(unquote(self.dem_url.removeprefix("file://"))))
