"""The experiments of the source documents, by paper as ``fusion.published`` has their estimators (see ``seeds.py``)."""
