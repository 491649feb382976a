"""A unit that is wrong shows in the sticks, whose slope is stiffness times drive speed whatever the friction."""

from __future__ import annotations

from pathlib import Path

import pytest

from data_io import Record
from experiments.study_problem import DEMO, RIG, SPEEDS, simulated_case
from identify import Scene, fit
from identify.effects import MAIN
from identify.estimation.status_words import wrong_unit
from identify.logs.prepare import Prepared, prepare
from identify.logs.unknowns import from_scene

pytestmark = pytest.mark.usefixtures("no_further_logs")

KILOGRAM = 9.80665  # N


def scene(speed: float) -> Scene:
    logs = [{"path": "log.csv", "drive_speed": speed}]
    return Scene.from_document({"effects": list(MAIN), "rig": dict(RIG), "logs": logs}, Path())


def scaled(times: float) -> Record:
    """The log at 1 mm/s with both forces off by a factor."""
    record = simulated_case(DEMO, 17).records[2]
    return Record(record.time, times * record.normal_force, times * record.friction_force)


def prepared(record: Record, speed: float = SPEEDS[2][0]) -> list[Prepared]:
    made = scene(speed)
    return [prepare(made, made.logs[0], record, from_scene(made))]


@pytest.mark.parametrize(("times", "placed"), [(KILOGRAM, True), (1e3, True), (1e-3, True), (1 / KILOGRAM, False)])
def test_a_wrong_unit_is_told_by_its_factor(times: float, placed: bool) -> None:
    said = wrong_unit(prepared(scaled(times)), placed=placed)
    assert said.startswith("in the sticks of log.csv the force rises")
    assert float(said.split("rises ")[1].split()[0]) == pytest.approx(times, rel=0.05)


@pytest.mark.parametrize(("times", "placed"), [(1.0, True), (1.0, False), (1 / KILOGRAM, True), (3.0, True)])
def test_what_a_soft_skin_or_a_rig_value_can_be_is_no_unit(times: float, placed: bool) -> None:
    assert wrong_unit(prepared(scaled(times)), placed=placed) == ""


@pytest.mark.parametrize("times", [KILOGRAM, 1 / KILOGRAM])
def test_a_fit_of_forces_in_kilograms_names_the_unit(times: float, one_try: None) -> None:
    result = fit(scene(SPEEDS[2][0]), [scaled(times)]).result
    assert result["status"] == "model_misfit" and "check the units" in result["message"]
    assert all(parameter["value"] is None for parameter in result["parameters"].values())
