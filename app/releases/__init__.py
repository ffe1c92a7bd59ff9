"""Editions of the map for the public, which tell nothing of a single owner.

Once in a while (``run``) the passes that may be told are chosen (``telling``): those over segments that enough distinct
owners drove, without the ends of trips (``ends``). The network is solved from these alone, in a schema of its own, and
what came of it is served from another one, to whoever has no key (``app.core.caller``).
"""
