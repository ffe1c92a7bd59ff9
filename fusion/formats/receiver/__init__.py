"""What u-blox receivers and NMEA recorders send, byte by byte: frames, messages, clocks, and the tables they become.

Knows no file format: a format opens a file and hands its bytes to ``stream``.
"""
