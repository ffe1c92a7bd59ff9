"""The files that a simulation leaves: map, elevation, logs, truth. One file per format; nothing here is moved."""
