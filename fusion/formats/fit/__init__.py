"""FIT, what Garmin, Wahoo and other bicycle computers, watches and cameras record."""
