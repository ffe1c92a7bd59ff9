"""Fixtures of drives under way."""

from live_support import live

__all__ = ["live"]
