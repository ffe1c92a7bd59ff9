"""${message}

Revision: ${up_revision}, after ${down_revision | comma,n}. Created ${create_date}.
"""

import sqlalchemy as sa
from alembic import op
from geoalchemy2 import Geometry
${imports if imports else ""}
revision = ${repr(up_revision)}
down_revision = ${repr(down_revision)}
branch_labels = ${repr(branch_labels)}
depends_on = ${repr(depends_on)}

# The revision of the oldest programs that work with what this leaves (app.core.migrate): expand, then contract.
oldest_program = ${repr(down_revision)}


def upgrade() -> None:
    """Apply."""
    ${upgrades if upgrades else "pass"}


def downgrade() -> None:
    """Take back."""
    ${downgrades if downgrades else "pass"}
