"""Methods ``gps-ins-kf``, ``gps-ins-ekf``, ``gps-ins-ukf``: Saadaoui 2011, chapter 4.

``models`` are the printed Algorithms 1, 2 and 3 as predict and correct, ``filter`` takes GPS and INS through one of
them, ``ins`` makes speed and heading of a log, ``method`` lays the result on roads. ``height`` is ours: the thesis is
two-dimensional.
"""
