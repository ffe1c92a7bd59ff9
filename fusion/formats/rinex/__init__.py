"""RINEX, the exchange format of raw satellite measurements and broadcast ephemerides (IGS, versions 2.11 to 4.0x)."""
