"""Scenes and drives of the shape of published experiments, for the benchmarks and for tests.

``calais`` (Al Assaad 2020) lays out an ``interchange`` on a ``board`` by road ``alignment``, with rasters of
``satellite_dem``; ``lahrech`` (Lahrech et al. 2005) drives through the library's town. The folder ``benchmarks`` is on
the path, so that these are imported as ``scenes``.
"""
