"""The elevation profile as a picture."""

from __future__ import annotations

from io import BytesIO

from app.outputs.profile import Profile
from app.outputs.profile_picture import DPI, profile_figure
from fusion.types import Measurements


def profile_png(
    profile: Profile, title: str, measurements: Measurements | None = None, *, dpi: int = DPI
) -> bytes:
    """A PNG with height above and slope below, each with its 95 % band, over the distance driven.

    ``measurements``: what the sensors said, drawn as pale dots behind.
    """
    buffer = BytesIO()
    figure = profile_figure(profile, printable(title), measurements, dpi=dpi)
    figure.savefig(buffer, format="png", metadata={"Software": "Versant"})
    return buffer.getvalue()


def printable(text: str) -> str:
    """A file's name, which is anyone's text, as a title: no mathtext, no control characters, no missing glyph."""
    kept = "".join(c if c.isprintable() and ord(c) < 0x250 else "?" for c in text)
    return kept.replace("$", r"\$")[:90]
