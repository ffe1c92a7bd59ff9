"""``python -m app.cli``: the same as ``versant``."""

from app.cli import main

main()
