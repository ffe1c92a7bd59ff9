"""The network adjustment of a whole country (``python -m country``)."""
