"""``make check`` runs the tests of what changed: those that import it, nearest first."""

from __future__ import annotations

from pathlib import Path

from changed_tests import MOST_STEPS, imports_in, nearest_tests, repository_imports

NEAR, FAR, BESIDE = Path("tests/test_near.py"), Path("tests/test_far.py"), Path("tests/test_beside.py")
SOURCE, OTHER, SUPPORT = Path("app/source.py"), Path("app/other.py"), Path("tests/support/things.py")
IMPORTS = {NEAR: {SOURCE}, FAR: {SUPPORT}, BESIDE: {OTHER}, SUPPORT: {SOURCE}, SOURCE: set(), OTHER: set()}


def test_who_imports_a_changed_file_comes_first_then_who_does_so_through_another() -> None:
    assert nearest_tests([SOURCE], IMPORTS) == [NEAR, FAR]
    assert nearest_tests([SUPPORT], IMPORTS) == [FAR]


def test_a_changed_test_comes_before_all_others() -> None:
    assert nearest_tests([SOURCE, BESIDE], IMPORTS) == [BESIDE, NEAR, FAR]


def test_who_is_further_than_a_few_files_away_is_left_out() -> None:
    chain = [Path(f"app/part_{number}.py") for number in range(MOST_STEPS)]
    imports = {Path("tests/test_end.py"): {chain[0]}, chain[0]: {chain[1]}, chain[1]: {SOURCE}}
    assert nearest_tests([chain[1]], imports) == [Path("tests/test_end.py")]
    assert nearest_tests([SOURCE], imports) == []


def test_fixtures_concern_the_tests_of_their_folder() -> None:
    inside, outside = Path("tests/app/jobs/test_queue.py"), Path("tests/app/map/test_tiles.py")
    imports: dict[Path, set[Path]] = {
        inside: set(),
        outside: set(),
        Path("tests/app/jobs/conftest.py"): set(),
    }
    assert nearest_tests([Path("tests/app/jobs/conftest.py")], imports) == [inside]


def test_every_form_of_import_is_seen() -> None:
    modules = {"a.b": Path("a/b.py"), "a.c": Path("a/c.py"), "a": Path("a/__init__.py"), "d": Path("d.py")}
    assert imports_in("import a.b", modules) == {modules["a.b"]}
    assert imports_in("def f():\n    from a import (\n        b,\n        c,\n    )\n", modules) == {
        modules["a"],
        modules["a.b"],
        modules["a.c"],
    }
    assert imports_in("from d import thing\nimport other", modules) == {modules["d"]}


def test_support_is_found_by_the_name_that_tests_import_it_by() -> None:
    imports = repository_imports()
    assert Path("tests/support/changed_tests.py") in imports[Path("tests/test_changed_tests.py")]
    assert Path("app/core/databases.py") in imports[Path("tests/conftest.py")]
