"""``versant score``: profiles of any program against surveyed heights."""
