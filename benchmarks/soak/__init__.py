"""A real service that is used and disturbed at random, and what is to be right once it has come to rest.

``python -m soak`` runs it, with ``benchmarks`` on the path; ``make soak`` does that for ten minutes.
"""
