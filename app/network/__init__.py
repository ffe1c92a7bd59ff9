"""Passes, evidence, the solution and what is published of it: the one room with locks."""
