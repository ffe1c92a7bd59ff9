"""What the benchmarks of accuracy share.

``sequences`` finds roads with known slopes and has logs of them fused; ``streets`` makes such roads up; ``logs`` makes
logs poorer; ``scoring`` makes figures of errors and tables of figures; ``stretches`` adds slopes up between known
heights. The folder ``benchmarks`` is on the path, so that these are imported as ``accuracy``.
"""
