"""Map matching: where on the road network a drive went.

``drive`` matches a whole drive by a hidden Markov model; ``points`` holds the matchers that place each position by
itself. Knows positions and roads; knows nothing of heights.
"""
