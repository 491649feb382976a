"""Pages for users name what there is: commands and options, scene keys, and the code of the Python page."""

import ast
import re
from pathlib import Path

import pytest

import identify
from identify.cli import main as cli
from identify.report.finished import Fit
from identify.scene.rig import DAMPING
from identify.scene.values import USUAL_TOLERANCES

DOCS = Path(__file__).resolve().parents[2] / "docs"
PAGES = ("measuring.md", "glossary.md", "faq.md", "python.md")


@pytest.mark.parametrize("page", PAGES)
def test_commands_and_options_are_there(page):
    text = " ".join((DOCS / page).read_text(encoding="utf-8").split())
    commands = cli.build_parser().commands
    for name, rest in re.findall(r"`stickslip ([a-z]+)([^`]*)`", text):
        assert name in commands, name
        for option in re.findall(r"--[a-z-]+", rest):
            assert option in commands[name]._option_string_actions, (name, option)


def test_every_way_to_state_the_damping_is_told():
    text = (DOCS / "measuring.md").read_text(encoding="utf-8")
    assert all(f"`{name}" in text for name in DAMPING) and "N s/m" in text
    stated = re.findall(r"^(\w+) = ", text[text.index("[tolerances]") :], re.MULTILINE)
    assert stated and set(stated) <= set(USUAL_TOLERANCES)


def test_the_python_page_calls_what_there_is():
    text = (DOCS / "python.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    tree = ast.parse(block)
    imported = [alias.name for node in tree.body if isinstance(node, ast.ImportFrom) and node.module == "identify"
                for alias in node.names]  # fmt: skip
    assert imported and all(hasattr(identify, name) for name in imported)
    used = {node.attr for node in ast.walk(tree) if isinstance(node, ast.Attribute)
            and isinstance(node.value, ast.Name) and node.value.id in ("found", "Fit")}  # fmt: skip
    assert {"parameters", "classical", "cycles", "plot", "predict", "simulate", "from_json"} == used
    assert all(hasattr(Fit, name) for name in used)
