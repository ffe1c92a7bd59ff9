"""Kinds of files that the map is written to."""
