"""What ends a batch. A log that cannot be used does not."""

from __future__ import annotations

from fusion.errors import FusionError


class BatchError(FusionError):
    """The batch cannot go on."""

    kind = "batch"
