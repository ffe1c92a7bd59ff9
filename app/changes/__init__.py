"""Following the map: what changed since a version, and being told of it."""
