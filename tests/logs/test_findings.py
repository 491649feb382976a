"""Every code that a finding can carry has a log that triggers it and one that just does not."""

import ast
import re

import pytest

from tests.support import finding_cases, verdict_cases

BY_THRESHOLD = {code for *_, code in verdict_cases.CASES.values()}
ELSEWHERE = {
    "read_in_part": "tests/cli/test_partly_read.py",
    "load_trembles": "tests/logs/test_live_load.py",  # so does how the fit takes the load
    "load_varies": "tests/logs/test_prepare.py",  # a warning of the fit: the scene's effects decide it
    "newest_first": "tests/data_io/test_clocks.py",
    "never_written": "tests/data_io/test_clocks.py",
    "counter_begins_anew": "tests/data_io/test_clocks.py",
    "packets": "tests/data_io/test_clocks.py",
    "pauses": "tests/data_io/test_clocks.py",
    "statistics_below": "tests/data_io/test_tables_as_people_keep_them.py",
    "no_value_mark": "tests/data_io/test_tables_as_people_keep_them.py",
    "swings": "tests/logs/test_looks_of_records.py",  # what such records look like at random, as the next two
    "upside_down": "tests/logs/test_looks_of_records.py",
    "zero_lost": "tests/logs/test_looks_of_records.py",
    "unreadable": "tests/logs/test_verdicts.py",
}
PAIRS = [(code, number) for code, pairs in finding_cases.CASES.items() for number in range(len(pairs))]


def codes_in(source):
    """The codes of findings that a module makes, as patterns: in `Finding(...)` and in documents."""
    for node in ast.walk(ast.parse(source)):
        values = []
        if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "Finding":
            values = [node.args[0]]
        elif isinstance(node, ast.Dict):
            values = [v for k, v in zip(node.keys, node.values, strict=True) if getattr(k, "value", "") == "code"]
        for value in values:
            if isinstance(value, ast.Constant):
                yield re.escape(value.value)
            elif isinstance(value, ast.JoinedStr):
                yield "".join(re.escape(p.value) if isinstance(p, ast.Constant) else ".+" for p in value.values)


def test_every_code_in_the_sources_has_its_pair(request):
    """A finding added without a pair fails here."""
    root = request.config.rootpath
    modules = [*(root / "data_io").glob("*.py"), *(root / "identify").rglob("*.py")]
    patterns = {code for path in modules for code in codes_in(path.read_text(encoding="utf-8"))}
    assert len(patterns) > 50
    listed = {*finding_cases.CASES, *BY_THRESHOLD, *ELSEWHERE}
    assert [pattern for pattern in patterns if not any(re.fullmatch(pattern, code) for code in listed)] == []
    assert [code for code in listed if not any(re.fullmatch(pattern, code) for pattern in patterns)] == []
    assert all((root / place).is_file() for place in ELSEWHERE.values())


def test_every_code_stands_in_the_page(request):
    page = (request.config.rootpath / "docs" / "quality.md").read_text(encoding="utf-8")
    listed = {*finding_cases.CASES, *BY_THRESHOLD, *ELSEWHERE}
    assert sorted(code for code in listed if f"`{code}`" not in page) == []


@pytest.mark.parametrize(("code", "number"), PAIRS)
def test_what_triggers_a_finding_and_what_just_does_not(tmp_path, code, number):
    beyond, within = finding_cases.CASES[code][number]
    for name, make, expected in (("beyond", beyond, True), ("within", within, False)):
        folder = tmp_path / name
        folder.mkdir()
        found = make(folder)
        assert (code in {finding.code for finding in found}) == expected, [f.code for f in found]
