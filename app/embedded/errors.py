"""What can go wrong with the embedded PostgreSQL; every message says what to do."""

from fusion.errors import FusionError


class EmbeddedPostgresError(FusionError):
    """The embedded PostgreSQL cluster cannot be used."""

    kind = "embedded-postgres"


class PostgresMissingError(EmbeddedPostgresError):
    """No suitable PostgreSQL server programs, or no PostGIS beside them, on this machine."""

    kind = "postgres-missing"


class NothingHereError(EmbeddedPostgresError):
    """There is no cluster where one is to be read."""

    kind = "nothing-here"
