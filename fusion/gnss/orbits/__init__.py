"""Where satellites are and what their clocks say, by broadcast ephemerides.

``satellites`` answers for all systems; ``selection`` chooses the record, ``kepler`` and ``glonass`` compute by it.
Knows no receiver: what is known of one is the time at which a signal left the satellite.
"""
