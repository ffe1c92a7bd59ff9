"""What a method is: the protocol that every estimator follows, and what all of them are given."""
