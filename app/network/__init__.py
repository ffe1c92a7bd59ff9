"""The stored map from all drives: passes, the solution, and what is published of it.

The one room with locks (``locks``). ``results`` stores a drive and leaves ``marks``; ``swap`` takes them through
``passes`` and ``solve`` to ``publish``. ``extracts`` reads roads, ``condensed`` holds old passes, ``cells`` the cells
and their versions. Knows no log, job or request.
"""

ZOOM = 14
"""A cell is a tile of this zoom. Here, so that whoever only names it loads no database."""
