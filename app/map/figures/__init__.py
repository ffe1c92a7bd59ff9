"""Figures of the whole map: what takes a look at every segment is made by a worker and kept."""
