"""What the code and the documents cite is there: sections of docs/equations.md, printed errors, pages."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
FOLDERS = ("identify", "data_io", "experiments", "tests", "docs")
EQUATIONS = (ROOT / "docs" / "equations.md").read_text(encoding="utf-8")
ERRORS = (ROOT / "docs" / "printed_errors.md").read_text(encoding="utf-8")
TEXTS = {
    path: path.read_text(encoding="utf-8")
    for path in [ROOT / "README.md", *(p for folder in FOLDERS for p in sorted((ROOT / folder).rglob("*")))]
    if path.suffix in (".py", ".md") and path != Path(__file__).resolve()
}
SECTIONS = re.compile(r"docs/equations\.md,\s+sections?\s+(\d+)(?:\s+(?:and|to)\s+(\d+))?")
LINKS = re.compile(r"\]\(([^)#:\s]+)(?:#[^)]*)?\)")


def test_cited_sections_of_the_equations_are_there():
    there = set(re.findall(r"^## (\d+)\. ", EQUATIONS, flags=re.MULTILINE))
    cited = {path: {n for found in SECTIONS.findall(text) for n in found if n} for path, text in TEXTS.items()}
    assert {n for numbers in cited.values() for n in numbers} == there, "each is cited, and none that is not there"
    assert sum(bool(numbers) for numbers in cited.values()) > 10
    for path, text in TEXTS.items():
        assert text.count("docs/equations.md,") == len(SECTIONS.findall(text)), f"{path}: a citation without a section"


@pytest.mark.parametrize(
    "path", [path for path, text in TEXTS.items() if re.search(r"\bE\d+\b.*printed|rrors.md, E", text)]
)
def test_cited_printed_errors_are_there(path):
    there = set(re.findall(r"^\| (E\d+) \|", ERRORS, flags=re.MULTILINE))
    assert set(re.findall(r"\bE[1-9]\d?\b", TEXTS[path])) <= there


@pytest.mark.parametrize("path", [p for p in TEXTS if p.suffix == ".md"], ids=lambda p: p.name)
def test_links_of_a_page_lead_somewhere(path):
    assert [to for to in LINKS.findall(TEXTS[path]) if not (path.parent / to).exists()] == []
