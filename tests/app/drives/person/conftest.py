"""Fixtures of an owner with drives."""

from person_support import anna

__all__ = ["anna"]
