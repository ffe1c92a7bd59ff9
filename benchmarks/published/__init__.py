"""The experiments of the source documents by paper, as ``fusion.published`` has their estimators. Run by ``seeds.py``."""
