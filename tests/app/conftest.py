"""Fixtures that tests of several rooms of the service share; each is described where it is defined."""

from access_support import keyed, keyed_filled
from browser_fixtures import browser, tab, tab_maker
from bucket_fixtures import bucket, bucket_server
from condensed_support import tiny
from drive_fixtures import context, files, send, town_database, town_rasters
from store_fixtures import add_drive, chain, segment_ids, sessions, streets, streets_apart
from web_fixtures import drive_maker, filled, grid_database, reading, server_maker, settings, web

__all__ = [
    "add_drive",
    "browser",
    "bucket",
    "bucket_server",
    "chain",
    "context",
    "drive_maker",
    "files",
    "filled",
    "grid_database",
    "keyed",
    "keyed_filled",
    "reading",
    "segment_ids",
    "send",
    "server_maker",
    "sessions",
    "settings",
    "streets",
    "streets_apart",
    "tab",
    "tab_maker",
    "tiny",
    "town_database",
    "town_rasters",
    "web",
]
