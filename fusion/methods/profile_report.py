"""What a drive's report says about how its profile was made."""

from __future__ import annotations

from typing import Any

import numpy as np

from fusion.factors import PassFactor
from fusion.methods.profile_model import MOUNT, Steps
from fusion.methods.profile_noise import Learned
from fusion.methods.profile_path import DrivenPath
from fusion.methods.profile_rows import Rows
from fusion.types import DriveLog


def drive_report(
    log: DriveLog,
    path: DrivenPath,
    rows: Rows,
    steps: Steps,
    learned: Learned,
    factors: tuple[PassFactor, ...],
) -> dict[str, Any]:
    noise = learned.noise
    return {
        "noise": {k: float(getattr(noise, k)) for k in noise.__dataclass_fields__},
        "outliers": int(learned.outlier.sum()),
        "mount": [
            float(learned.smoothed.mean[-1, MOUNT]),
            float(np.sqrt(learned.smoothed.covariance[-1, MOUNT, MOUNT])),
        ],
    }
