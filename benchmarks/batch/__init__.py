"""Archives of logs in bulk (``python -m batch``)."""
