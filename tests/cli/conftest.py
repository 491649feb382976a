import pytest


@pytest.fixture
def work(monkeypatch):
    """Have `stickslip fit` do something else."""

    def put(run):
        monkeypatch.setattr("identify.cli.fit.fit_logs", run)

    return put
