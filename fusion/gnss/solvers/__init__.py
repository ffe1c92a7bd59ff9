"""Solvers: from corrected measurements to positions, one file with a class each. Registered in ``fusion.gnss``."""
