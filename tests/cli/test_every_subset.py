"""Every sensible subset of the effects runs through simulation, fit, report and calculators.

The fits are cheap: 1.5 s of a log simulated with the same effects, of which only the two friction levels are searched.
"""

import json
from itertools import product

import pytest

from identify.effects import ALL
from tests.support.command import stickslip

pytestmark = pytest.mark.usefixtures("no_further_logs")

DAMPING = ("", "hysteresis_damping", "driven_damping")
AGEING = ("", "contact_ageing")
LAW = ("", "linear_weakening", "velocity_weakening")
USUAL = tuple(tuple(filter(None, ("inertia", *some))) for some in product(DAMPING, AGEING, LAW))
WITH_ONE_MORE = tuple(
    ("inertia", "contact_ageing", *effect.needs, effect.name)
    for effect in ALL
    if effect.name not in {name for names in USUAL for name in names} | {"power_law"}  # it strengthens: no slips
)
FAST = {("inertia", "contact_ageing", "velocity_weakening")}
VALUES = {"D": 20e-6, "t_cr": 0.3, "delta_mu_k": -0.05, "slope": -0.5}


def scene_text(names, searched=("mu_s", "mu_k0"), logs=("log.csv",)):
    lines = [f"effects = {json.dumps(names)}", "[rig]", 'normal_force = "2 N"', 'drive_speed = "1 mm/s"']
    lines += ["stiffness = 2000", "mass = 0.15", *(["damping = 50"] if set(names) & set(DAMPING) else [])]
    lines += ["[parameters]", "mu_s = { start = 0.5 }", "mu_k0 = { start = 0.35 }"]
    parameters = [q for effect in ALL if effect.name in names for q in effect.parameters]
    for parameter in (q for q in parameters if q.name not in ("mass", "damping")):
        kind = "start" if parameter.name in searched else "fixed"
        lines.append(f"{parameter.name} = {{ {kind} = {VALUES.get(parameter.name, parameter.default)} }}")
    lines += [f'[[logs]]\npath = "{log}"\nlabels = {{ material = "a" }}' for log in logs]
    return "\n".join(lines)


CALCULATORS = (
    ("stability", "--result", "out/result.json", "--advice"),
    ("amplitude", "--result", "out/result.json", "--json"),
    ("stability", "--scene", "scene.toml"),
    ("compare", "out", "--by", "material", "--out", "compared"),
)


@pytest.mark.parametrize(
    "names",
    [
        pytest.param(names, id="+".join(names), marks=() if names in FAST else pytest.mark.slow)
        for names in (*USUAL, *WITH_ONE_MORE)
    ],
)
def test_a_scene_with_any_effects_is_simulated_fitted_reported_and_calculated(folder, capsys, names):
    (folder / "scene.toml").write_text(scene_text(names), encoding="utf-8")
    log = ("simulate", "--scene", "scene.toml", "--duration", "1.5 s", "--rate", "1 kHz", "--noise", "5 mN")
    assert stickslip(capsys, *log, "--out", "log.csv")[0] == 0
    code, _, err = stickslip(capsys, "fit", "--scene", "scene.toml", "--out", "out")
    assert code in (0, 3), err
    result = json.loads((folder / "out" / "result.json").read_text(encoding="utf-8"))
    assert (result["status"] == "converged") is (code == 0)
    assert (folder / "out" / "report.html").is_file()
    if code == 0:
        for command in CALCULATORS:
            code, _, err = stickslip(capsys, *command)
            assert code == 0 or (code == 2 and names not in FAST), (command, err)  # 2: say, what changes with the clock
    assert names not in FAST or result["status"] == "converged"


@pytest.mark.slow  # recovery without it: tests/estimation/test_fit.py
def test_two_speeds_without_damping_give_the_values_they_were_made_with(folder, capsys):
    """The simplest scene with ageing: every true value lies within its interval."""
    truth = {"mu_s": 0.5, "mu_k0": 0.35, "D": 20e-6, "t_cr": 0.3}
    names, logs = ("inertia", "contact_ageing"), ("1 mm/s", "0.2 mm/s")
    text = scene_text(names, tuple(truth), ("log_1.csv", "log_2.csv"))
    for speed in logs:
        text = text.replace("labels =", f'drive_speed = "{speed}"\nlabels  =', 1)
    (folder / "scene.toml").write_text(text, encoding="utf-8")
    for number, (speed, duration) in enumerate(zip(logs, ("3 s", "15 s"), strict=True), 1):
        log = ("--duration", duration, "--rate", "400 Hz", "--noise", "5 mN", "--out", f"log_{number}.csv")
        one = ("simulate", "--scene", "scene.toml", "--set", f'rig.drive_speed="{speed}"', "--seed", number)
        assert stickslip(capsys, *one, *log)[0] == 0
    code, _, err = stickslip(capsys, "fit", "--scene", "scene.toml", "--out", "out")
    assert code == 0, err
    found = json.loads((folder / "out" / "result.json").read_text(encoding="utf-8"))["parameters"]
    for name, value in truth.items():
        low, high = found[name]["interval"]
        assert low <= value <= high, name
        assert found[name]["verdict"] == "identified"
