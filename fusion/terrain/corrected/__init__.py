"""Elevation models in which roads have the heights that were measured on them."""
