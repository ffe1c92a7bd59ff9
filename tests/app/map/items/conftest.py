"""The database that these tests read."""

from items_support import items

__all__ = ["items"]
