"""Positions from pseudoranges by Viandier 2011: filters, laws of the errors, and how well a law holds."""
