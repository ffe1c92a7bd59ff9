"""What the parser of commands says by itself, in the person's language: headings, help, wrong usage."""

from __future__ import annotations

import gettext
import re
import string
from typing import Any

import typer

from app.cli.console import language, spoken
from app.core.messages import say
from fusion.messages import catalogue


def speak() -> None:
    """Have gettext, which Typer and argparse ask for their words, answer from the catalogues."""
    vars(gettext)["dgettext"] = lambda _domain, text: spoken(text)


def in_words(command: Any) -> Any:
    """The command, or the group with all below it, with its help in the person's language."""
    if language() == "en":
        return command
    usage = command.get_usage
    command.get_usage = lambda ctx: usage(ctx).replace("Usage:", spoken("Usage:"), 1)
    command.options_metavar = spoken(command.options_metavar or "")
    command.help, command.epilog = paragraphs(command.help), paragraphs(command.epilog)
    asks_for_help = command.get_help_option(typer.Context(command))
    for one in (*command.params, *([asks_for_help] if asks_for_help else [])):
        one.help = paragraphs(getattr(one, "help", None))
    below = getattr(command, "commands", {})
    if isinstance(below, dict):  # the root's are translated as they are loaded
        for one in below.values():
            in_words(one)
    if hasattr(command, "subcommand_metavar"):
        command.subcommand_metavar = spoken(command.subcommand_metavar or "")
    return command


def paragraphs(text: str | None) -> str | None:
    """Help, each of whose paragraphs is a phrase of the catalogue."""
    if not text:
        return text
    return "\n\n".join(spoken(" ".join(one.split())) for one in text.split("\n\n"))


def usage_in_words(text: str) -> str:
    """What the parser says of wrong usage, by the template of the catalogue that it is made by."""
    if language() == "en":
        return text
    templates = {key: one for key, one in catalogue("en").items() if key.startswith("usage.")}
    for key in sorted(templates, key=lambda one: len(templates[one]), reverse=True):  # what says more first
        if found := re.fullmatch(_pattern(templates[key]), text, re.DOTALL):
            return spoken(
                say(key, **{name: usage_in_words(part) for name, part in found.groupdict().items()})
            )
    return spoken(text)


def _pattern(template: str) -> str:
    """The template as a regular expression, a group for each parameter."""
    parts = string.Formatter().parse(template)
    return "".join(re.escape(fixed) + (f"(?P<{name}>.*?)" if name else "") for fixed, name, _, _ in parts)
