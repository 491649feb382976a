"""docs/effects.md is up to date, its example works as it says, and what is off is counted as not there."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import casadi as ca
import pytest

import identify.model.model
from experiments import effect_cost, run_effect_table
from identify.effects import ALL
from identify.model.model import assemble

ROOT = Path(__file__).resolve().parents[2]
PAGE = run_effect_table.PAGE.read_text(encoding="utf-8")
EVERY = pytest.mark.parametrize("effect", ALL, ids=lambda effect: effect.name)


def test_table_of_effects_is_up_to_date():
    assert run_effect_table.page_with({"effects": run_effect_table.effects_table()}, PAGE) == PAGE


def test_counted_costs_are_up_to_date():
    if f"Counted with CasADi {ca.__version__}." not in PAGE:
        pytest.skip("another version of CasADi counts otherwise")
    few = tuple(e for e in ALL if e.name in ("contact_ageing", "sensor_lag", "excitation"))
    for row in run_effect_table.cost_table(few):
        assert row in PAGE.splitlines()


# ---- off costs nothing


@EVERY
def test_an_effect_that_is_off_is_counted_as_not_there(effect, monkeypatch):
    less, more = effect_cost.pair(effect)
    off = assemble(less)
    others = tuple(e for e in ALL if e is not effect)
    monkeypatch.setattr(identify.model.model, "ALL", others)
    monkeypatch.setattr(identify.model.model, "NAMES", tuple(e.name for e in others))
    gone = assemble.__wrapped__(less)
    assert gone.states == off.states and gone.parameters == off.parameters
    for name in effect_cost.COUNTED:
        assert getattr(gone, name).n_instructions() == getattr(off, name).n_instructions()
    monkeypatch.undo()
    on = assemble(more)
    if effect.parameters:  # control: the counts see what is on
        counts = [sum(getattr(m, name).n_instructions() for name in effect_cost.COUNTED) for m in (off, on)]
        assert len(on.parameters) > len(off.parameters) and counts[1] != counts[0]


# ---- the example


def _copy_with_example(folder: Path) -> str:
    """A copy of the package and the tests with file, line and import that the page tells to add: the effect's name."""
    for name in ("identify", "data_io", "tests", "experiments"):
        shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "pyproject.toml", folder)
    part = PAGE[PAGE.index("## Adding an effect") :]
    source, line, imported = re.findall(r"```(?:python)?\n(.*?)```", part, flags=re.DOTALL)
    name = imported.split()[1].rpartition(".")[2]
    (folder / "identify" / "effects" / f"{name}.py").write_text(source, encoding="utf-8")
    table = folder / "identify" / "effects" / "__init__.py"
    text = table.read_text(encoding="utf-8")
    for before, new in (("    DirectEffect(),\n", line), ("import DirectEffect\n", imported)):
        assert text.count(before) == 1
        text = text.replace(before, before + new)
    table.write_text(text, encoding="utf-8")
    return name


def _changed(folder: Path) -> set[str]:
    """Files of the package that differ from ours, or are new."""
    changed = set()
    for path in (folder / "identify").rglob("*.py"):
        ours = ROOT / path.relative_to(folder)
        if not ours.exists() or ours.read_bytes() != path.read_bytes():
            changed.add(str(path.relative_to(folder / "identify")))
    return changed


SCENE = """
effects = ["inertia", "hysteresis_damping", "contact_ageing", "velocity_weakening"{more}]
[rig]
mass = "0.2 kg"
stiffness = "1470 N/m"
damping = "147 N/m"
drive_speed = "1 mm/s"
normal_force = "1 N"
[parameters]
{parameter}
"""


@pytest.mark.slow
def test_the_example_is_one_file_and_one_line(tmp_path):
    name = _copy_with_example(tmp_path)
    assert _changed(tmp_path) == {f"effects/{name}.py", "effects/__init__.py"}
    contract = [f"tests/effects/{file}.py" for file in ("test_effects", "test_effects_absent")]
    told = _run(tmp_path, ["-m", "pytest", "-vv", "-p", "no:cacheprovider", *contract, "-k", name])
    assert len(re.findall(rf"{name}\] PASSED", told)) >= 15, told
    logs = []
    for more, parameter in (("", ""), (f', "{name}"', 'film_slope = { fixed = "3 s/m" }')):
        scene, log = tmp_path / f"scene{len(logs)}.toml", tmp_path / f"log{len(logs)}.csv"
        scene.write_text(SCENE.format(more=more, parameter=parameter), encoding="utf-8")
        _run(tmp_path, f"-m identify simulate --scene {scene} --duration 1 --rate 200 --out {log}".split())
        logs.append(log.read_text(encoding="utf-8"))
    assert logs[0] != logs[1]


def _run(folder: Path, arguments: list[str]) -> str:
    """A Python of its own in that folder, so that nothing of ours is imported: what it prints."""
    environment = os.environ | {"PYTHONPATH": str(folder), "PYTHONPYCACHEPREFIX": str(folder / "bytecode")}
    done = subprocess.run(
        [sys.executable, *arguments], cwd=folder, capture_output=True, text=True, env=environment, timeout=300
    )
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-2000:]
    return done.stdout
