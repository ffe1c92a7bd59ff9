"""The database's schema, step by step (alembic; configured in pyproject.toml)."""
