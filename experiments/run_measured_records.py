"""The whole chain on measured stick-slip records, paper on paper: what the fit says of each file by itself.

The records (README beside them) are not part of the project; without them the script says so and stops.
Mass and stiffness are estimated within wide bounds, as the records' description advises.

    python experiments/run_measured_records.py [folder of the records]
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from identify.effects import MAIN as NAMES
from identify.estimation.attempt import Clock
from identify.identification import find
from identify.scene import Scene

RECORDS = Path(__file__).resolve().parents[2] / "shared" / "data" / "paper_on_paper"
MASS = 0.019  # [kg], from the ringing
FILES = {"k168_v42": 168.0, "k168_v1100": 168.0, "k1002_v42": 1002.0, "k1002_v4300": 1002.0}
TOGETHER = (("k168_v42", "k168_v1100"), ("k1002_v42", "k1002_v4300"))


def scene_of(names: tuple[str, ...], folder: Path) -> Scene:
    """The scene of records of one spring; the drive speed [um/s] stands in the file name."""
    stiffness = FILES[names[0]]
    document = {
        "effects": [*NAMES, "varying_normal_force"],
        "rig": {"mass": MASS, "stiffness": stiffness, "zeta": 0.02},
        "parameters": {
            "mass": {"lower": 0.3 * MASS, "upper": 2.5 * MASS},
            "stiffness": {"lower": 0.6 * stiffness, "upper": 1.6 * stiffness},
        },
        "logs": [{"path": str(folder / f"{n}.csv"), "drive_speed": 1e-6 * float(n.split("_v")[1])} for n in names],
    }
    return Scene.from_document(document)


def main(fast: bool = False, folder: Path = RECORDS) -> dict[tuple[str, ...], str]:
    """Status by file, and by pair of files of one spring; fast: one file only. Empty where the records are absent."""
    if not folder.is_dir():
        print(f"{folder.name}: no measured records here; give their folder as argument")
        return {}
    found = {}
    for names in [("k1002_v4300",)] if fast else [*((n,) for n in FILES), *TOGETHER]:
        began = time.process_time()
        logs, findings = find(scene_of(names, folder), clock=Clock(), progress=lambda _stage, _share: None)
        found[names] = findings.status.value
        cycles = ", ".join(f"{log.falls.size} cycles, drop scatters {100 * log.scatter:.0f} %" for log in logs)
        print(f"{' + '.join(names)}: {findings.status.value} ({time.process_time() - began:.1f} s)\n  {cycles}")
        print(f"  {findings.message}", flush=True)
    return found


if __name__ == "__main__":
    main(folder=Path(sys.argv[1]) if len(sys.argv) > 1 else RECORDS)
