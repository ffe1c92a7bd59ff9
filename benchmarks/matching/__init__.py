"""What the benchmark of map matching rests on: hand-corrected ``tracks``, and ``leuven``, another matcher.

The folder ``benchmarks`` is on the path, so that these are imported as ``matching``.
"""
