"""Fixtures of a service that asks for keys."""

from access_support import guarded, shared

__all__ = ["guarded", "shared"]
