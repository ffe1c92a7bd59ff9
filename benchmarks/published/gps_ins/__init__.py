"""Saadaoui 2011: Kalman filters of GPS and INS on simulated drives."""
