"""Positions from raw GNSS measurements: orbits, corrections, laws of errors, solvers. Knows no road."""
