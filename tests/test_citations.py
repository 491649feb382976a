"""What the code and the documents cite is there: sections of docs/equations.md, printed errors, pages."""

import re
from pathlib import Path

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


def test_cited_printed_errors_are_there():
    there = set(re.findall(r"^\| (E\d+) \|", ERRORS, flags=re.MULTILINE))
    citing = {path: text for path, text in TEXTS.items() if re.search(r"\bE\d+\b.*printed|rrors.md, E", text)}
    assert {path for path, text in citing.items() if not set(re.findall(r"\bE[1-9]\d?\b", text)) <= there} == set()


def test_links_of_a_page_lead_somewhere():
    links = [(path, to) for path, text in TEXTS.items() if path.suffix == ".md" for to in LINKS.findall(text)]
    assert len(links) > 50 and [(path, to) for path, to in links if not (path.parent / to).exists()] == []
