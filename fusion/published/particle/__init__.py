"""Method ``particle``: Al Assaad 2020, a cloud of particles in compiled loops, or its Kalman filters.

Chapter 2: GNSS, acceleration, map, terrain. Chapter 3: pitch and windows of the elevation model as well. ``method`` is
the entry. ``filter`` leads the cloud: ``sense_pass`` predicts and weighs by the sensors, (2.1)-(2.18); ``locate_pass``
weighs by road and terrain, (2.27)-(2.38); ``layout`` is the cloud in memory. ``kalman_loop`` is the extended and the
linear Kalman filter of the same system, (1.33)-(1.37). Motion, measurements and map matching are
those of ``nine_state``.
"""
