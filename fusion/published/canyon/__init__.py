"""Street canyons: fronts of houses along a drive, satellites above, and what a receiver measures between them.

``ride`` -> ``fronts`` -> ``sky`` -> ``sight`` -> ``radio`` -> ``drive``. Everything random comes from an ``rng`` or a
seed. What each measurement's true error was is known, so that solvers and error models can be judged.
"""
