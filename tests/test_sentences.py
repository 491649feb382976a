"""Sentences for people are in the words of papers: no personified data, no private vocabulary."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
FORBIDDEN = re.compile(
    r"\b(?:told|tells?|telling|foretold|trembl\w+|wander\w*|hardly|anew|mended|mend|strained|worn|amiss|counsel|outlook"
    r"|rehears\w*|shaken|hopeless|crept|nought|rhythms?|put away|stands? out|hold(?:s)? too (?:little|few)"
    r"|took no part|on its way|swings? by)\b"
    r"|\b(?:data|logs?|fits?|forces?|records?|curves?|model|noise|scene|peaks|slips)"
    r" (?:do(?:es)? not )?(?:tell|hold|know|say|see|ask|want|object|wish|follow its)s?\b",
    re.IGNORECASE,
)


def literals(source: str) -> Iterator[tuple[int, str]]:
    """Line and text of every string literal with a blank that is no docstring."""
    tree = ast.parse(source)
    notes = {id(n.value) for n in ast.walk(tree) if isinstance(n, ast.Expr) and isinstance(n.value, ast.Constant)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and id(node) not in notes and isinstance(node.value, str):
            yield from [(node.lineno, node.value)] if " " in node.value else []


def sentences(path: Path) -> Iterator[tuple[int, str]]:
    source = path.read_text(encoding="utf-8")
    return literals(source) if path.suffix == ".py" else iter(enumerate(source.splitlines(), start=1))


def files() -> Iterator[Path]:
    for folder in ("identify", "data_io"):
        yield from (p for end in ("py", "js", "html", "j2") for p in sorted((ROOT / folder).rglob(f"*.{end}")))
    yield from (ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md")))


def test_no_sentence_has_a_forbidden_word() -> None:
    found = [
        f"{path.relative_to(ROOT)}:{line}: {match.group(0)!r} in {text.strip()[:100]!r}"
        for path in files()
        if "uPlot" not in path.name and path.stem != "python_reference"
        for line, text in sentences(path)
        for match in FORBIDDEN.finditer(text)
    ]
    assert not found, "\n".join(found)


@pytest.mark.parametrize(
    "text", ["the log does not tell it", "the data ask for more", "the level wanders", "as it said"]
)
def test_a_forbidden_word_is_found_in_a_message_and_not_in_a_docstring(text: str) -> None:
    lines = [
        line for line, words in literals(f'"""{text}"""\n\nMESSAGE = f"{text} {{1}}"\n') if FORBIDDEN.search(words)
    ]
    assert lines == ([] if text == "as it said" else [3])
