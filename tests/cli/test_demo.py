"""`stickslip demo`: both of its fits have to succeed."""

import json

import pytest

import identify.report
from identify import identification
from identify.cli import main as cli
from tests.support.fake_fit import failed, fake_fit


@pytest.mark.parametrize(("joint", "slow", "code"), [(True, True, 0), (True, False, 3), (False, True, 3)])
def test_the_exit_code_is_that_of_both_fits(monkeypatch, tmp_path, capsys, joint, slow, code):
    fit = fake_fit()
    found = [fit if good else failed(fit, "model_misfit", "the model does not fit") for good in (joint, slow)]
    left = iter(found)
    monkeypatch.setattr(identification, "fit", lambda *_, **__: next(left))
    monkeypatch.setattr(identify.report, "write_report", lambda *_: None)
    assert cli.main(["demo", "--out", str(tmp_path / "demo"), "--json"]) == code
    document = json.loads(capsys.readouterr().out)
    assert (document["status"], document["at_50_Hz"]["status"]) == tuple(each.status.value for each in found)
