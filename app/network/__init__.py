"""The stored map from all drives: passes, the solution, and what is published of it.

The one room with locks. ``results`` is the way in, ``passes`` -> ``solve`` -> ``publish`` the way through; ``extracts``
and ``surroundings`` read the roads, ``versions`` holds the lock and the number of the published data. Knows no log,
job or request.
"""
