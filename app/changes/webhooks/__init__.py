"""Addresses that are told of events: signed messages, sent again until they are taken."""
