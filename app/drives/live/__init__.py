"""Drives under way: points that phones and trackers send by themselves, until silence makes logs of them."""
