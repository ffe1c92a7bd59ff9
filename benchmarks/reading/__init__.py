"""How fast logs are read: ``python -m reading``."""
