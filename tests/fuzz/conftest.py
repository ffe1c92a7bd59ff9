"""The databases and the service that fuzzers ask."""

from items_support import items
from web_fixtures import drive_maker, filled, grid_database, settings, web

__all__ = ["drive_maker", "filled", "grid_database", "items", "settings", "web"]
