"""Every sensible subset of the effects runs through simulation, fit, report and calculators.

The fits are cheap: 1.5 s of a log simulated with the same effects, of which only the two friction levels are searched.
"""

import json
from itertools import product

import pytest

from identify.effects import ALL
from tests.support.command import stickslip

DAMPING = ("", "hysteresis_damping", "driven_damping")
AGEING = ("", "contact_ageing")
LAW = ("", "linear_weakening", "velocity_weakening")
USUAL = tuple(tuple(filter(None, ("inertia", *some))) for some in product(DAMPING, AGEING, LAW))
WITH_ONE_MORE = tuple(
    ("inertia", "contact_ageing", *effect.needs, effect.name)
    for effect in ALL
    if effect.name not in {name for names in USUAL for name in names} | {"power_law"}  # it strengthens: no slips
)
VALUES = {"D": 20e-6, "t_cr": 0.3, "delta_mu_k": -0.05, "slope": -0.5}


def scene_text(names):
    lines = [f"effects = {json.dumps(names)}", "[rig]", 'normal_force = "2 N"', 'drive_speed = "1 mm/s"']
    lines += ["stiffness = 2000", "mass = 0.15", *(["damping = 50"] if set(names) & set(DAMPING) else [])]
    lines += ["[parameters]", "mu_s = { start = 0.5 }", "mu_k0 = { start = 0.35 }"]
    parameters = [q for effect in ALL if effect.name in names for q in effect.parameters]
    for parameter in (q for q in parameters if q.name not in ("mass", "damping")):
        lines.append(f"{parameter.name} = {{ fixed = {VALUES.get(parameter.name, parameter.default)} }}")
    return "\n".join([*lines, '[[logs]]\npath = "log.csv"\nlabels = { material = "a" }'])


CALCULATORS = (
    ("amplitude", "--result", "out/result.json", "--json"),
    ("stability", "--result", "out/result.json", "--advice"),
    ("compare", "out", "--by", "material", "--out", "compared"),
)


@pytest.mark.slow  # of one composition: tests/cli/test_fit_command.py
@pytest.mark.parametrize("names", (*USUAL, *WITH_ONE_MORE), ids="+".join)
def test_a_scene_with_any_effects_is_simulated_fitted_reported_and_calculated(folder, capsys, names):
    (folder / "scene.toml").write_text(scene_text(names), encoding="utf-8")
    log = ("simulate", "--scene", "scene.toml", "--duration", "1.5 s", "--rate", "1 kHz", "--noise", "5 mN")
    assert stickslip(capsys, *log, "--out", "log.csv")[0] == 0
    code, _, err = stickslip(capsys, "fit", "--scene", "scene.toml", "--out", "out")
    assert code in (0, 3), err
    result = json.loads((folder / "out" / "result.json").read_text(encoding="utf-8"))
    assert (result["status"] == "converged") is (code == 0)
    assert (folder / "out" / "report.html").is_file()
    for command in CALCULATORS if code == 0 else ():
        code, _, err = stickslip(capsys, *command)
        assert code in (0, 2), (command, err)  # 2: as of what changes with the clock
