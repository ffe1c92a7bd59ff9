"""Method ``odometer-map``: Lahrech, Boucher, Choquel and Noyer 2005.

An extended Kalman filter over GNSS, or over wheels and map where GNSS is missing. ``state`` is the motion (1),
``odometry`` what wheels measure of it, ``filter`` one epoch after the other, ``method`` the entry, and the counters of
a log at its epochs. The run through a drive is ``nine_state``'s.
"""
