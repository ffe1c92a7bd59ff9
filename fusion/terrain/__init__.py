"""Terrain: elevation rasters as one surface, triangulated or as planes fitted around road segments."""
