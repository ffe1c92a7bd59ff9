"""The estimators of the source documents, by paper, and what their experiments need; ours is ``fusion.profile``.

Each folder's head names the paper, its equations, and where the rest of its files stand. ``epochs`` (one clock,
levelling, lines through altitudes) and ``nine_state`` are shared; options are under ``fusion.options``.

* ``particle``: Al Assaad 2020, the particle filter of chapters 2 and 3, and ``ukf_dem``, which it is compared with;
* ``matchers``: the map matchers of the survey in Al Assaad 2020, 1.3.1;
* ``odometer_map``: Lahrech 2005;
* ``gps_ins``: Saadaoui 2011;
* ``positioning``: Viandier 2011, filters and laws of pseudorange errors, and ``canyon``, the street they are tried in;
* ``nine_state``: the state that ``particle``, ``odometer_map`` and ``ukf_dem`` share.
"""
