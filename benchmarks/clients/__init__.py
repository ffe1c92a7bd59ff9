"""Clients that nobody here wrote, each reading all segments of a real map: what they get, beside SQL."""
