"""The databases and the service that fuzzers ask."""

from items_support import items
from web_fixtures import drive_maker, filled, settings, web

__all__ = ["drive_maker", "filled", "items", "settings", "web"]
