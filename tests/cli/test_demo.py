"""`stickslip demo`: its fit has to succeed."""

import json

import pytest

import identify.report
from identify import identification
from identify.cli import main as cli
from tests.support.fake_fit import failed, fake_fit


@pytest.mark.parametrize("good", [True, False])
def test_the_exit_code_is_that_of_the_fit(monkeypatch, tmp_path, capsys, good):
    fit = fake_fit()
    found = fit if good else failed(fit, "model_misfit", "the model does not fit")
    monkeypatch.setattr(identification, "fit", lambda *_, **__: found)
    monkeypatch.setattr(identify.report, "write_report", lambda *_: None)
    assert cli.main(["demo", "--out", str(tmp_path / "demo"), "--json"]) == (0 if good else 3)
    assert json.loads(capsys.readouterr().out)["status"] == found.status.value
