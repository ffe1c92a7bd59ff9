"""Versant's estimation library: vehicle logs, roads and terrain in; road slopes with their uncertainty out.

Arrays in, estimates out. Nothing here knows a web, a database or an environment variable, and nothing
here imports ``app``.
"""

__version__ = "0.1.0"
