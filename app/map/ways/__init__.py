"""Ways: consecutive segments of one OpenStreetMap way as one, with what was measured of all of it."""
