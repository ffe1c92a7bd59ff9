"""The experiments of the source documents, by paper as in ``fusion.published``; ``seeds.py`` runs them."""
