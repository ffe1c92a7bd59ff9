"""The map served: one segment, tiles, OGC API Features, files."""
