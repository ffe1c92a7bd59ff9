"""Terrain: elevation rasters as one surface, triangulated or as planes fitted around road segments.

``raster`` reads one file, ``mosaic`` joins those of one grid, ``dem`` stacks mosaics; ``tin`` and ``plane`` are the
surfaces through posts; ``windows`` puts them under roads, which nothing else here knows.
"""
