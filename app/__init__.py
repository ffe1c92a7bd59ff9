"""The service: a thin shell around ``fusion`` that stores drives and roads and serves slopes."""
