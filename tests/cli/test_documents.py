"""Pages for users name what there is: commands and options, scene keys, and the code of the Python page."""

import ast
import json
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure

from data_io import Record, write_csv
from experiments.make_notebook import notebook
from identify.base.document import as_json
from identify.cli import main as cli
from tests.support.fake_fit import fit_of_a_scene

DOCS = Path(__file__).resolve().parents[2] / "docs"
PAGES = ("measuring.md", "glossary.md", "faq.md", "python.md")


@pytest.mark.parametrize("page", PAGES)
def test_commands_and_options_are_there(page):
    text = " ".join((DOCS / page).read_text(encoding="utf-8").split())
    (commands,) = (each.choices for each in cli.build_parser()._actions if each.dest == "command")
    said = re.findall(r"`(?:\S*/)?stickslip ([a-z]+)([^`]*)`", text)
    blocks = "\n".join(re.findall(r"```sh\n(.*?)```", (DOCS / page).read_text(encoding="utf-8"), re.DOTALL))
    for name, rest in [*said, *re.findall(r"stickslip ([a-z]+)(.*)", blocks)]:
        assert name in commands, name
        for option in re.findall(r"--[a-z-]+", rest):
            assert option in commands[name]._option_string_actions, (name, option)


def test_the_python_page_runs(tmp_path, monkeypatch):
    """Its block, line by line with a fit that is given, and every line shows something; the notebook has a real one."""
    text = (DOCS / "python.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("identify.report.figures.available", lambda _: {})  # each is drawn by its own line
    monkeypatch.setattr("identify.fit", lambda *_, **__: fit_of_a_scene())
    write_csv(Record(np.arange(9.0), np.ones(9), np.ones(9)), tmp_path / "slow.csv")
    (tmp_path / "stickslip-pair").mkdir()
    space, shown = {}, []
    for node in ast.parse(block).body:
        line = ast.unparse(node)
        if "from_json" in line:
            (tmp_path / "stickslip-pair" / "result.json").write_text(as_json(space["found"].result), encoding="utf-8")
        if isinstance(node, ast.Expr):
            shown.append(eval(line, space))
        else:
            exec(line, space)
    found = space["found"]
    assert found.result["status"] == "converged" and "mu_s" in repr(found) and "parameters" in found._repr_html_()
    assert len(shown) == 19 and all(value is not None for value in shown)
    assert [len(value) > 0 for value in shown if isinstance(value, pd.DataFrame)] == [True] * 5


def run_cell(source, space):
    """Run the lines of a cell; the value of its last one where that is an expression."""
    body = ast.parse(source).body
    last = ast.Expression(body.pop().value) if isinstance(body[-1], ast.Expr) else None
    exec(compile(ast.Module(body, []), "cell", "exec"), space)
    return None if last is None else eval(compile(last, "cell", "eval"), space)


@pytest.mark.slow
def test_the_notebook_runs_and_shows_what_it_says(tmp_path, monkeypatch):
    """Its cells, one after the other; its tables hold what they gave when it was made."""
    page = json.loads((DOCS / "notebook.ipynb").read_text(encoding="utf-8"))
    plain = [{key: cell[key] for key in ("cell_type", "source")} for cell in page["cells"]]
    assert plain == [{key: cell[key] for key in ("cell_type", "source")} for cell in notebook()["cells"]]
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("identify.report.figures.pictures", lambda _: ())  # one is drawn by its own cell
    space, pictures, tables = {}, 0, 0
    for cell in page["cells"]:
        if cell["cell_type"] == "markdown":
            continue
        value = run_cell(cell["source"], space)
        shown = [output["data"] for output in cell["outputs"] if output["output_type"] == "execute_result"]
        if isinstance(value, Figure):
            assert value._repr_png_().startswith(b"\x89PNG") and "image/png" in shown[0]
            pictures += 1
        elif isinstance(value, pd.DataFrame):
            cells = re.findall(r"<td>(.*?)</td>", "".join(shown[0]["text/html"]))
            stored = pd.DataFrame(np.reshape(cells, value.shape), columns=value.columns)
            numbers = value.select_dtypes("number")
            np.testing.assert_allclose(stored[numbers.columns].astype(float), numbers, rtol=1e-3, atol=1e-6)
            tables += 1
    assert pictures == 3 and tables == 5
    assert "identified" in space["found"]._repr_html_() and (tmp_path / "two-logs" / "report.html").exists()
