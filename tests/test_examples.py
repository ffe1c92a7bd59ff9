"""The notebook and the script of the documentation run, and the notebook shows what it gives.

``python tests/test_examples.py --write`` runs the notebook and stores what its cells show. No Jupyter is needed.
"""

from __future__ import annotations

import ast
import base64
import io
import json
import re
import sys
import tempfile
import warnings
from collections.abc import Iterator
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any

import geopandas
import matplotlib as mpl
import pandas as pd
import pytest

import fusion
from fusion.simulate.demonstration import Demonstration, write_all

DOCS = Path(__file__).resolve().parents[1] / "docs"
NOTEBOOK = DOCS / "files" / "notebook.ipynb"
MOST_BYTES = 150_000
NUMBER = re.compile(r"[-+−]?\d+(?:\.\d+)?(?:e[-+]\d+)?")


def notebook() -> dict[str, Any]:
    found: dict[str, Any] = json.loads(NOTEBOOK.read_text(encoding="utf-8"))
    return found


def run_cells(cells: list[dict[str, Any]]) -> Iterator[list[dict[str, Any]]]:
    """What each code cell shows: its prints, the value of its last expression, and the figures it leaves open."""
    wide = pd.option_context("display.width", 120, "display.max_columns", 20)  # whatever terminal there is
    with mpl.rc_context({"backend": "agg", "figure.dpi": 70}), wide:
        import matplotlib.pyplot as plt  # noqa: PLC0415 - after the choice of what it draws on

        names: dict[str, Any] = {"__name__": "__main__"}
        for number, cell in enumerate((c for c in cells if c["cell_type"] == "code"), 1):
            tree, printed, value = ast.parse("".join(cell["source"])), io.StringIO(), None
            last = tree.body.pop() if tree.body and isinstance(tree.body[-1], ast.Expr) else None
            with redirect_stdout(printed):
                exec(compile(tree, f"cell {number}", "exec"), names)  # noqa: S102 - our own notebook
                if isinstance(last, ast.Expr):
                    value = eval(compile(ast.Expression(last.value), f"cell {number}", "eval"), names)  # noqa: S307
            pictures = [plt.figure(k) for k in plt.get_fignums()]
            yield list(outputs(number, printed.getvalue(), value, pictures))
            plt.close("all")


def outputs(number: int, printed: str, value: Any, pictures: list[Any]) -> Iterator[dict[str, Any]]:
    """The outputs of a cell as nbformat 4 has them."""
    if printed:
        yield {"name": "stdout", "output_type": "stream", "text": printed.splitlines(keepends=True)}
    if value is not None:
        data = {"text/plain": repr(value).splitlines(keepends=True)}
        if hasattr(value, "_repr_html_"):
            data["text/html"] = value._repr_html_().splitlines(keepends=True)
        yield {"data": data, "execution_count": number, "metadata": {}, "output_type": "execute_result"}
    for figure in pictures:
        png = io.BytesIO()
        figure.savefig(png, format="png", bbox_inches="tight", metadata={"Software": "Versant"})
        picture = {"image/png": base64.b64encode(png.getvalue()).decode()}
        yield {"data": picture, "metadata": {}, "output_type": "display_data"}


def shown(outputs: list[dict[str, Any]]) -> str:
    """All text of a cell's outputs, without pictures and HTML."""
    return "".join("".join(o.get("text") or o["data"].get("text/plain", "")) for o in outputs)


@pytest.mark.slow
def test_the_notebook_shows_what_its_cells_give(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    cells = notebook()["cells"]
    stored = [cell for cell in cells if cell["cell_type"] == "code"]
    pictures = 0
    for cell, given in zip(stored, run_cells(cells), strict=True):
        before, now = shown(cell["outputs"]), shown(given)
        assert NUMBER.sub("#", before).split() == NUMBER.sub("#", now).split(), (
            "run: python tests/test_examples.py --write"
        )
        numbers = [[float(n.replace("−", "-")) for n in NUMBER.findall(text)] for text in (before, now)]
        assert numbers[1] == pytest.approx(numbers[0], rel=0.03, abs=0.05)
        kinds = [[o["output_type"] for o in outputs] for outputs in (cell["outputs"], given)]
        assert kinds[0] == kinds[1]
        pictures += kinds[0].count("display_data")
    assert pictures == 1


def test_the_notebook_is_sound_small_and_names_no_place() -> None:
    found, text = notebook(), NOTEBOOK.read_text(encoding="utf-8")
    assert (found["nbformat"], found["nbformat_minor"]) == (4, 5)
    assert len({cell["id"] for cell in found["cells"]}) == len(found["cells"])
    code = [cell for cell in found["cells"] if cell["cell_type"] == "code"]
    assert [cell["execution_count"] for cell in code] == list(range(1, len(code) + 1))
    assert len(text) < MOST_BYTES
    said = "".join("".join(c["source"]) + shown(c.get("outputs", [])) for c in found["cells"])
    assert not re.search(r"(?<![\w.:/<])/(?:tmp|home|root|work|usr|var)\b", said)
    assert "Warning" not in said


def test_what_the_page_names_of_the_library_is_offered() -> None:
    section = (DOCS / "how-to" / "use-from-python.md").read_text(encoding="utf-8")
    called = set(re.findall(r"fusion\.(\w+)[.(]", section))
    listed = {
        name
        for row in re.findall(r"^\| (`.*?) \|", section, re.MULTILINE)
        for name in re.findall(r"`(\w+)", row)
    }
    assert {"read_log", "solve", "track_frame"} <= called
    assert called <= listed - {"fusion"} <= set(fusion.HOMES)
    assert set(fusion.HOMES) - listed == {"Solution"}


@pytest.fixture(scope="module")
def bundle(tmp_path_factory: pytest.TempPathFactory) -> Demonstration:
    return write_all(tmp_path_factory.mktemp("town"), 2, seed=1, duration_s=60.0)


@pytest.mark.slow
def test_the_script_makes_a_file_of_logs(
    bundle: Demonstration, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "slopes.gpkg"
    arguments = [*bundle.drives, "--roads", bundle.osm, "--dem", bundle.dem, "-o", out]
    monkeypatch.setattr(sys, "argv", ["example.py", *map(str, arguments)])
    script = (DOCS / "files" / "example.py").read_text(encoding="utf-8")
    exec(compile(script, "example.py", "exec"), {"__name__": "__main__", "__doc__": "x"})  # noqa: S102 - our own
    printed = capsys.readouterr().out
    segments = geopandas.read_file(out)
    assert f"slopes.gpkg: {len(segments)} segments" in printed
    assert len(segments) > 5
    assert (segments.slope_sigma_percent > 0).all()


@pytest.mark.slow
def test_the_page_on_reports_has_every_field(bundle: Demonstration) -> None:
    page = (DOCS / "reference" / "drive-report.md").read_text(encoding="utf-8")
    stored = page.partition("## Added when")[0]
    cells = re.findall(r"^\| (`.*?) \|", stored, re.MULTILINE)
    named = [name for cell in cells for name in re.findall(r"`(\w+)`", cell)]
    roads, dem = fusion.read_roads(bundle.osm), fusion.Dem.open([bundle.dem])
    _, result = fusion.run_drive(fusion.read_log(bundle.drives[0]), roads, dem)
    assert sorted(named) == sorted(result.report)


if __name__ == "__main__":
    if sys.argv[1:] != ["--write"]:
        sys.exit(__doc__)
    document = notebook()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        results = run_cells(document["cells"])
        for count, one in enumerate((c for c in document["cells"] if c["cell_type"] == "code"), 1):
            one["outputs"], one["execution_count"] = next(results), count
    NOTEBOOK.write_text(json.dumps(document, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
