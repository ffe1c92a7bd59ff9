"""The experiments of the source documents, one file each, and their tables; ``seeds.py`` runs them."""
