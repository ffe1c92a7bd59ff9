"""Lahrech et al. 2005: a drive in town with two outages of GPS."""
