"""Networks for the tests of this room."""

from road_fixtures import make_network, make_table

__all__ = ["make_network", "make_table"]
