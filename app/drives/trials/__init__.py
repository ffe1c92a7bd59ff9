"""Trials: a drive computed by another method for a look at it. Nothing of a trial ever reaches the map."""
