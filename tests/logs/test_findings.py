"""Every code that a finding can carry has a log that triggers it and one that just does not."""

import pytest

from tests.support import finding_cases, verdict_cases

PAIRS = [(code, number) for code, pairs in finding_cases.CASES.items() for number in range(len(pairs))]


def test_every_code_stands_in_the_page(request):
    page = (request.config.rootpath / "docs" / "quality.md").read_text(encoding="utf-8")
    listed = {*finding_cases.CASES, *(case[3] for case in verdict_cases.CASES.values())}
    assert sorted(code for code in listed if f"`{code}`" not in page) == []


@pytest.mark.parametrize(("code", "number"), PAIRS)
def test_what_triggers_a_finding_and_what_just_does_not(tmp_path, code, number):
    beyond, within = finding_cases.CASES[code][number]
    for name, make, expected in (("beyond", beyond, True), ("within", within, False)):
        folder = tmp_path / name
        folder.mkdir()
        found = make(folder)
        assert (code in {finding.code for finding in found}) == expected, [f.code for f in found]
