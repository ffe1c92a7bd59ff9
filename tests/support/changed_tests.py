"""Which test files hold what has changed, nearest first: ``python tests/support/changed_tests.py [BASE]`` prints them.

Changed is what differs from ``BASE``: by default from where the branch left ``main``, on ``main`` itself from the last
commit, and where nothing differs, what the last commit brought. Near is who imports the changed file; a test file
that imports it through more than ``MOST_STEPS`` files is left to ``make test``.
"""

from __future__ import annotations

import re
import subprocess
import sys
from collections import defaultdict
from collections.abc import Iterable, Mapping
from pathlib import Path

from source_tree import REPOSITORY, sources, text_of_file

MOST_STEPS = 2
"""From a test file to the changed file: 1 is a test that imports it."""
ALWAYS = (
    "tests/test_layout.py",
    "tests/test_architecture.py",
    "tests/test_readme.py",
    "tests/app/core/test_openapi.py",
    "tests/fusion/methods/test_contract.py",
)
"""The layout and the contracts, which any change can break."""
_FOLDERS = ("app", "fusion", "migrations", "benchmarks", "tests")
_ROOTS = ("", "tests/support", "benchmarks")
"""Where tests find modules: the repository, and the folders that pytest is told of."""
_IMPORT = re.compile(r"^ *(?:from|import) +([\w.]+)(?: +import +(\([^)]*\)|.*))?", re.MULTILINE)
"""Reading text takes a tenth of the time that syntax trees of all files take."""


def changed_files(base: str = "") -> set[Path]:
    """The Python files that were changed or added since ``base``, committed or not; relative to the repository."""
    new = _git("ls-files", "--others", "--exclude-standard")
    for start in (base,) if base else (_fork_point(), "HEAD~1"):
        changed = {*_git("diff", "--name-only", "--diff-filter=d", start), *new}
        if changed:
            return {Path(name) for name in changed if name.endswith(".py")}
    return set()


def nearest_tests(changed: Iterable[Path], imports: Mapping[Path, Iterable[Path]]) -> list[Path]:
    """The test files that are changed, stand under a changed ``conftest.py``, or import a changed file; nearest first.

    ``imports`` names for each file of the repository those that it imports from.
    """
    importers: dict[Path, set[Path]] = defaultdict(set)
    for path, targets in imports.items():
        for target in targets:
            importers[target].add(path)
    steps = dict.fromkeys(changed, 0)
    for step in range(1, MOST_STEPS + 1):
        for path in [path for path, least in steps.items() if least == step - 1]:
            below = {p for p in imports if path.name == "conftest.py" and p.is_relative_to(path.parent)}
            for importer in importers[path] | below:
                steps.setdefault(importer, step)
    near = [path for path in steps if path.parts[0] == "tests" and path.name.startswith("test_")]
    return sorted(near, key=lambda path: (steps[path], path))


def imports_in(text: str, modules: Mapping[str, Path]) -> set[Path]:
    """The files that a source names in import statements; ``modules`` maps dotted names to the repository's files."""
    named: set[str] = set()
    for module, names in _IMPORT.findall(text):
        named |= {
            module,
            *(f"{module}.{name}" for name in re.findall(r"\w+", names)),
        }  # a name may be a module
    return {modules[name] for name in named if name in modules}


def repository_imports() -> dict[Path, set[Path]]:
    """For each Python file of the repository those that it imports from."""
    paths = [path for folder in _FOLDERS for path in sources(folder)]
    modules = {
        ".".join(path.relative_to(root).with_suffix("").parts).removesuffix(".__init__"): path
        for path in paths
        for root in _ROOTS
        if path.is_relative_to(root)
    }
    return {path: imports_in(text_of_file(path), modules) - {path} for path in paths}


def _fork_point() -> str:
    return next(iter(_git("merge-base", "HEAD", "main")), "HEAD")


def _git(*arguments: str) -> list[str]:
    """Lines of what git answers; none where it refuses, as outside of a repository."""
    command = ["git", "-c", f"safe.directory={REPOSITORY}", *arguments]
    return subprocess.run(
        command, cwd=REPOSITORY, capture_output=True, text=True, check=False
    ).stdout.splitlines()


def main() -> None:
    """Print the layout's and the contracts' files, then those of what has changed."""
    near = [str(path) for path in nearest_tests(changed_files(*sys.argv[1:2]), repository_imports())]
    always = [name for name in ALWAYS if (REPOSITORY / name).exists()]
    print("\n".join(dict.fromkeys([*always, *near])))  # noqa: T201 - this is what it is for


if __name__ == "__main__":
    main()
