"""The errors of the library, one tree.

FusionError
├── LogError            a drive log cannot be used
│   ├── UnknownFormatError       no known format recognises the bytes
│   ├── EmptyLogError            a known format, but no usable position in it
│   ├── MalformedLogError        a known format, broken beyond skipping
│   └── NotOnRoadsError          recorded as a sport that nobody asked for, such as swimming
├── RoadsError          a road file cannot be used
├── TerrainError        an elevation raster cannot be used
├── ControlError        a file of surveyed heights cannot be used
└── MethodError         a method cannot do what was asked
    ├── UnknownNameError         a name that no registry holds
    ├── BadOptionsError          options that the method does not take
    ├── MissingSensorError       the log lacks what the method needs
    └── NoMatchError             the log never comes near a road

Every message is one or more whole sentences for the person who supplied the input: what is wrong, where
in the input, and what to do about it.
"""


class FusionError(Exception):
    """Base of all errors of the library; ``str(error)`` is a message for a person."""

    kind: str = "error"
    """Stable machine-readable identifier (kebab-case), used in problem documents and statistics."""

    def __init__(self, message: str, *, where: str | None = None) -> None:
        """``where`` names the line, byte offset or field at fault, for callers that show it apart."""
        super().__init__(message)
        self.where = where


class LogError(FusionError):
    """A drive log cannot be used."""

    kind = "bad-log"


class UnknownFormatError(LogError):
    """No known format recognises the bytes."""

    kind = "unknown-format"


class EmptyLogError(LogError):
    """A known format, but no usable position in it."""

    kind = "empty-log"


class MalformedLogError(LogError):
    """A known format, broken beyond skipping."""

    kind = "malformed-log"


class NotOnRoadsError(LogError):
    """Recorded as a sport that is not wanted."""

    kind = "not-on-roads"


class RoadsError(FusionError):
    """A road file cannot be used."""

    kind = "bad-roads"


class TerrainError(FusionError):
    """An elevation raster cannot be used."""

    kind = "bad-terrain"


class ControlError(FusionError):
    """A file of surveyed heights cannot be used."""

    kind = "bad-control"


class MethodError(FusionError):
    """A method cannot do what was asked."""

    kind = "method-failed"


class UnknownNameError(MethodError):
    """A name that no registry holds."""

    kind = "unknown-name"


class BadOptionsError(MethodError):
    """Options that the method does not take."""

    kind = "bad-options"


class MissingSensorError(MethodError):
    """The log lacks what the method needs."""

    kind = "missing-sensor"


class NoMatchError(MethodError):
    """The log never comes near a road."""

    kind = "no-match"
