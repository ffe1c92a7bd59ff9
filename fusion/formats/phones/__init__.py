"""Logs of phones, whose axes are not the vehicle's."""
