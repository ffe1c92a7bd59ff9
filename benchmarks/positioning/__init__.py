"""What ``pseudorange.py`` measures: real logs as measurements, estimators from the literature, and tables."""
