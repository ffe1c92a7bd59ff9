"""The files that a simulation leaves: map, elevation, logs, truth."""
