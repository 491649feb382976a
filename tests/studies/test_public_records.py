"""docs/public_records.md: its scene and manifest, on simulated records of the layout of the ring-shear data."""

import csv
import re
from pathlib import Path

import numpy as np
import pytest

from identify.scene import Scene
from identify.studies.planning import plan

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "public_records.md").read_text(encoding="utf-8")
SPRINGS = {1: 4e5, 2: 6e5, 3: 8e5, 4: 1.2e6}  # N/m
STRESSES = (5, 10, 15, 20)  # kPa
SPEEDS = tuple(np.geomspace(2e-2, 8e-4, 9).tolist())  # mm/s
LASTS, RATE = 60.0, 10.0


def block(kind):
    (text,) = re.findall(rf"```{kind}\n(.*?)```", PAGE, re.DOTALL)
    return text


def experiment(path, spring, stress):
    """Nine speeds one after the other in one file, stresses in kPa; not simulated but of the layout."""
    time = np.arange(int(len(SPEEDS) * LASTS * RATE)) / RATE
    wave = 0.45 + 0.05 * ((time / 3.0) % 1.0) + 0.001 * np.random.default_rng(spring).standard_normal(time.size)
    rows = np.column_stack([time, np.full(time.size, float(stress)), stress * wave])
    np.savetxt(path, rows, "%.6g", ",", header="Time [s],Normal stress [kPa],Shear stress [kPa]", comments="")


def write_manifest(folder, experiments):
    heads, *_ = csv.reader(block("csv").splitlines())
    with (folder / "beads.csv").open("w", newline="") as handle:
        table = csv.writer(handle)
        table.writerow(heads)
        for spring, stress in experiments:
            for i, speed in enumerate(SPEEDS):
                name, speed_text = f"spring_{spring}_{stress}kPa.csv", f"{speed:.6g} mm/s"
                window, rigidity = f"[{i * LASTS:g}, {(i + 1) * LASTS:g}]", f"{SPRINGS[spring]:g} N/m"
                group, load = f"spring {spring} at {stress} kPa", f"{stress} kPa"
                table.writerow([name, group, speed_text, rigidity, window, spring, load])
    (folder / "beads.toml").write_text(block("toml"))


def test_all_144_rows_are_planned_as_16_joint_fits(tmp_path):
    experiments = [(spring, stress) for spring in SPRINGS for stress in STRESSES]
    for spring, stress in experiments:
        experiment(tmp_path / f"spring_{spring}_{stress}kPa.csv", spring, stress)
    write_manifest(tmp_path, experiments)
    jobs = plan(tmp_path / "beads.csv", tmp_path / "beads.toml").jobs
    assert len(jobs) == 16 and sum(len(job.logs) for job in jobs) == 144
    scene = Scene.from_document(jobs[0].scene)
    assert scene.rig.stiffness == 4e5 and sorted({log.drive_speed for log in scene.logs})[-1] == pytest.approx(2e-5)
    (tmp_path / "page.csv").write_text(block("csv"))
    assert len(plan(tmp_path / "page.csv", tmp_path / "beads.toml").jobs) == 1, "the rows of the page, as they stand"
