"""How evidence grows: one street with more and more passes (``python -m evidence``)."""
