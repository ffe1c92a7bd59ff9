"""Synthetic towns and drives with known truth: ``scene`` -> ``motion`` -> ``receiver`` -> ``drive`` -> ``write``.

Everything random comes from seeds: the same seed makes the same files. Knows nothing of estimation.
"""
