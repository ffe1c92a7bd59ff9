"""One kind of registry for everything that can be chosen by name: formats, methods, windows, outputs."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from typing import TypeVar

from fusion.errors import BadOptionsError, UnknownNameError
from fusion.messages import say

T = TypeVar("T")

# What is taken where nobody chooses. Here, so that whoever only shows these names loads no method for it.
DEFAULT_METHOD = "profile"
"""The estimator; one of ``METHOD_NAMES``."""
METHOD_NAMES = (
    "profile",
    "particle",
    "odometer-map",
    "gps-ins-kf",
    "gps-ins-ekf",
    "gps-ins-ukf",
    "ukf-dem",
    "raw",
    "dem",
)
"""What ``fusion.catalogue.METHODS`` holds (a test holds them equal)."""
DEFAULT_POSITIONING = "auto"
"""How positions are computed from a log; one of ``fusion.catalogue.POSITIONINGS``."""

LOG_COLUMNS: tuple[str, ...] = (
    "time", "time_s", "lat_deg", "lon_deg", "alt_msl_m", "height_ell_m", "h_acc_m", "v_acc_m",
    "vel_n_mps", "vel_e_mps", "vel_d_mps", "s_acc_mps", "speed_mps", "heading_deg",
    "acc_x_mps2", "acc_y_mps2", "acc_z_mps2", "gyr_x_dps", "gyr_y_dps", "gyr_z_dps",
    "roll_deg", "pitch_deg", "yaw_deg", "pitch_acc_deg",
    "wheel_left_rad", "wheel_right_rad", "odo_speed_mps", "pressure_hpa", "temperature_c",
)  # fmt: skip
"""The columns of a CSV log, as Versant calls them."""


def check_columns(columns: Mapping[str, str]) -> None:
    """Refuse names on the left that are none of ``LOG_COLUMNS``: ``BadOptionsError`` names what is near."""
    for ours, theirs in columns.items():
        if ours not in LOG_COLUMNS:
            alike = [name for name in LOG_COLUMNS if ours and name.startswith(ours.lower()[:3])][:3]
            near = alike or get_close_matches(ours.lower(), LOG_COLUMNS, 3, 0.6)
            meant = (
                say("columns.near_ours", near=" or ".join(near))
                if near
                else say("columns.there_are", names=", ".join(LOG_COLUMNS))
            )
            raise BadOptionsError(
                say("columns.not_ours", ours=ours[:60], theirs=theirs[:60], meant=meant),
                where="columns",
            )
        if not theirs.strip():
            raise BadOptionsError(say("columns.names_none", ours=ours), where="columns")


def unknown_name(role: str, name: str, known: Iterable[str]) -> UnknownNameError:
    """What is raised for a name that is not ``known``; ``role`` is the singular noun for what has such names."""
    return UnknownNameError(say("options.no_such", role=role, name=name, names=", ".join(known)))


class Registry(dict[str, T]):
    """Name -> thing, in order of registration; a duplicate is refused, an unknown name answered with the known ones."""

    def __init__(self, role: str) -> None:
        """``role`` is the singular noun that error messages use, such as ``method``."""
        super().__init__()
        self.role = role

    def add(self, name: str, thing: T) -> T:
        """Register ``thing``; raises ``ValueError`` when the name is taken."""
        if name in self:
            raise ValueError(f"{self.role} {name!r} is registered twice")
        self[name] = thing
        return thing

    def __missing__(self, name: str) -> T:
        """Raise ``UnknownNameError`` listing what there is."""
        raise unknown_name(self.role, name, self)


@dataclass(frozen=True)
class RequestMost:
    """Marks a number among options, in ``Annotated``: who runs a service lets strangers ask for so much at most."""

    most: float
