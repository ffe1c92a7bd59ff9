"""The map from all drives: heights of the roads as one sparse least-squares problem.

Knows evidence, roads and the prior; knows neither logs nor sensors nor how a pass became evidence.
"""
