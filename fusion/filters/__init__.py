"""The textbook algorithms, free of any model."""
