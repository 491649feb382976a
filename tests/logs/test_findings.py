"""Every code that a finding can carry has a log that triggers it and one that just does not."""

import pytest

from tests.support import finding_cases, verdict_cases

BY_THRESHOLD = {code for *_, code in verdict_cases.CASES.values()}
ELSEWHERE = {
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
