"""``versant keys``, and the first key of a service."""
