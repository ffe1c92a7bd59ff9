"""A service under attack, and the client that goes on working meanwhile: ``python -m hostile``."""
