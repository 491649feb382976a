"""How many cycles and volunteers: against simulated studies, and known limits."""

import json

import pytest

from experiments.run_power_study import main
from identify.base.errors import IdentifyError
from identify.bench.power import TwoMaterials, cycles_needed
from identify.cli import main as cli


def test_chances_are_those_of_simulated_studies(capsys):
    assert all(abs(predicted - found) < 0.05 for predicted, found in main(fast=True))


def test_the_fewest_volunteers_are_the_fewest():
    design = TwoMaterials(0.15, 0.2, 0.2, 0.1, 20, True)
    fewest = design.volunteers(0.8)
    assert design.chance(fewest) >= 0.8 > design.chance(fewest - 1)
    assert TwoMaterials(0.15, 0.2, 0.2, 0.1, 20, False).volunteers(0.8) > 2 * fewest
    assert TwoMaterials(1e-3, 0.2, 0.2, 0.1, 20, False).volunteers(0.8) is None
    with pytest.raises(IdentifyError, match="differ by more than 0"):
        TwoMaterials(0.0, 0.2, 0.2, 0.1, 20, True)


def test_cycles_of_a_scatter_of_20_percent():
    """1.96 * 0.2/sqrt(n) <= ln 1.1."""
    assert cycles_needed(0.2, 0.1) == 17 and cycles_needed(0.2, 0.05) == 65


def test_the_command_counts_without_a_scene(capsys):
    assert cli.main(["plan", "--difference", "15 %", "--scatter", "20 %", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["volunteers"]["paired"] < document["volunteers"]["groups"] and document["cycles"] == 17
