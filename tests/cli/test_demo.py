"""`stickslip demo`: all of its fits have to succeed."""

import json

import pytest

import identify.report
from identify import identification
from identify.cli import main as cli
from tests.support.fake_fit import failed, fake_fit


@pytest.mark.parametrize(
    ("good", "code"),
    [((True, True, True), 0), ((True, False, True), 3), ((True, True, False), 3), ((False, True, True), 3)],
)
def test_the_exit_code_is_that_of_all_fits(monkeypatch, tmp_path, capsys, good, code):
    fit = fake_fit()
    found = [fit if each else failed(fit, "model_misfit", "the model does not fit") for each in good]
    left = iter(found)
    monkeypatch.setattr(identification, "fit", lambda *_, **__: next(left))
    monkeypatch.setattr(identify.report, "write_report", lambda *_: None)
    assert cli.main(["demo", "--out", str(tmp_path / "demo"), "--json"]) == code
    document = json.loads(capsys.readouterr().out)
    parts = (document, document["at_50_Hz"], document["uneven"])
    assert [part["status"] for part in parts] == [each.status.value for each in found]
