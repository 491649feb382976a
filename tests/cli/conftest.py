from dataclasses import replace

import pytest

from identify.cli import fit as fit_group


@pytest.fixture
def work(monkeypatch):
    """Have `stickslip fit` do something else."""

    def put(run):
        (fit,) = (command for command in fit_group.COMMANDS if command.name == "fit")
        monkeypatch.setattr(fit_group, "COMMANDS", (replace(fit, run=run),))

    return put
