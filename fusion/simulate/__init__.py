"""Synthetic towns and drives with known truth."""
