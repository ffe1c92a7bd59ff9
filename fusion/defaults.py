"""What is taken where nobody chooses. Stands alone: whoever only shows these names loads no method for it."""

DEFAULT_METHOD = "profile"
"""The estimator; one of ``fusion.methods.METHODS``."""

DEFAULT_POSITIONING = "receiver"
"""How positions are computed from a log; one of ``fusion.gnss.POSITIONINGS``."""
