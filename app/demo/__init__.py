"""The whole job on data that it makes itself."""
