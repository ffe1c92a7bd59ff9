"""The sources read as text: which files there are, and what each imports."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parents[2]
PACKAGES = ("fusion", "app", "migrations")


def sources(folder: str) -> list[Path]:
    """Every Python file below a folder, relative to the repository."""
    return [path.relative_to(REPOSITORY) for path in sorted((REPOSITORY / folder).rglob("*.py"))]


def text_of_file(path: Path) -> str:
    """What a file of the repository holds."""
    return (REPOSITORY / path).read_text(encoding="utf-8")


@cache
def tree_of(path: Path) -> ast.Module:
    """A file of the repository as a syntax tree."""
    return ast.parse(text_of_file(path), filename=str(path))


def lines_of(path: Path) -> int:
    """How long a file of the repository is."""
    return len(text_of_file(path).splitlines())


def name_of(node: ast.expr) -> str:
    """``f`` of ``f`` and of ``a.b.f``."""
    if isinstance(node, ast.Attribute):
        return node.attr
    return node.id if isinstance(node, ast.Name) else ""


def text_of(node: ast.AST) -> str:
    """The value of a string literal, else an empty string."""
    return node.value if isinstance(node, ast.Constant) and isinstance(node.value, str) else ""


def imported_names(tree: ast.Module) -> Iterator[tuple[int, str]]:
    """(line, absolute dotted name) of all that is imported: in functions, for type checkers and by ``importlib`` too.

    ``from a.b import c`` gives ``a.b.c``: c may be a module.
    """
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            yield from ((node.lineno, f"{node.module}.{alias.name}") for alias in node.names)
        elif isinstance(node, ast.Call) and name_of(node.func) in {"import_module", "__import__"}:
            yield from ((node.lineno, text) for argument in node.args if (text := text_of(argument)))


@cache
def file_of(dotted: str) -> Path | None:
    """The file of this repository that a dotted name is a module of, or stands in; None for other packages."""
    parts = dotted.split(".")
    if parts[0] not in PACKAGES:
        return None
    for length in (len(parts), len(parts) - 1):
        place = Path(*parts[:length]) if length else None
        for candidate in (place.with_suffix(".py"), place / "__init__.py") if place else ():
            if (REPOSITORY / candidate).exists():
                return candidate
    return None


@cache
def imports_of(path: Path) -> frozenset[Path]:
    """The files of this repository that a file imports from."""
    named = (file_of(name) for _, name in imported_names(tree_of(path)))
    return frozenset(place for place in named if place is not None and place != path)
