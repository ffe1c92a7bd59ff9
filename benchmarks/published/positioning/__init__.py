"""Viandier 2011 and the literature beside: real logs as measurements, robust estimators, slopes from raw signals."""
