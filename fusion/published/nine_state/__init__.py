"""What the filters over nine states share: Al Assaad 2020, chapter 2.

``motion`` is the transition and its noise (2.1), ``measurements`` and ``sensors`` what a vehicle measures. ``run``
takes a drive through any filter that follows ``protocol``, and holds the matched road (2.27)-(2.31) and the ground
(3.12); ``protocol`` collects what the filter says as well. Used by ``particle``, ``odometer_map`` and ``ukf_dem``.
"""
