"""How long the page of 200 fits takes, and how large it is.

One real fit is made; its folder stands for 200 with parameters drawn as in the study of pooling, each with its own
labels and the curves of the real one.

    python experiments/run_page_speed.py [fits]
"""

from __future__ import annotations

import copy
import json
import os
import shutil
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from experiments.machine import describe
from experiments.pooling_draws import Plan, draw
from identify import examples
from identify.identification import fit
from identify.report import write_report
from identify.scene import Scene
from identify.studies.comparison_page import write_batch_report

NAMES = ("mu_s", "mu_k0", "delta_mu_k", "a", "D", "t_cr")
LOGARITHMIC = (False, False, False, True, True, True)


def write_batch(folder: Path, real: Path, fits: int, seed: int = 1) -> None:
    """So many folders of fits: four materials (one, of few fits), ten volunteers, as many runs as it takes."""
    base = json.loads((real / "result.json").read_text(encoding="utf-8"))
    materials = 4 if fits > 40 else 1
    runs = -(-fits // (10 * materials))
    study = draw(Plan("page", materials=materials, volunteers=10, runs=runs, gap=1.0), np.random.default_rng(seed))
    assert study.setting.subject is not None
    for i in np.linspace(0, len(study.y) - 1, fits).astype(int).tolist():
        told = copy.deepcopy(base)
        sd = np.sqrt(np.diag(study.noise[i]))
        for k, name in enumerate(NAMES):
            value = float(np.exp(study.y[i, k])) if LOGARITHMIC[k] else float(study.y[i, k])
            error = float(sd[k]) * (value if LOGARITHMIC[k] else 1.0)
            ends = [value - 1.96 * error, value + 1.96 * error]
            told["parameters"][name] |= {"value": value, "standard_error": error, "interval": ends}
            told["parameters"][name] |= {"verdict": "identified", "reason": ""}
        told["correlation"] = {"names": list(NAMES), "matrix": (study.noise[i] / np.outer(sd, sd)).tolist()}
        for log in told["logs"]:
            log["labels"] = {"material": study.setting.group[i], "volunteer": study.setting.subject[i]}
        own = folder / f"fit_{i + 1:03d}"
        own.mkdir()
        (own / "result.json").write_text(json.dumps(told), encoding="utf-8")
        for name in ("result.h5", "report.html"):
            try:
                os.link(real / name, own / name)
            except OSError:
                shutil.copy(real / name, own / name)


def main(fast: bool = False, fits: int = 200) -> None:
    """200 fits; fast: 4 fits of three logs, of one material."""
    print(describe())
    with tempfile.TemporaryDirectory() as spare:
        real, batch = Path(spare) / "real", Path(spare) / "batch"
        batch.mkdir()
        whole = Scene.from_toml(examples.SCENE)
        write_report(fit(whole.choose([str(log.path) for log in whole.logs[1:]]) if fast else whole), real)
        write_batch(batch, real, 4 if fast else fits)
        began, processor = time.perf_counter(), time.process_time()
        page = write_batch_report(batch)
        seconds, busy = time.perf_counter() - began, time.process_time() - processor
        print(
            f"page of {4 if fast else fits} fits: {seconds:.1f} s ({busy:.1f} s of the processor), "
            f"{page.stat().st_size / 1e6:.2f} MB"
        )


if __name__ == "__main__":
    main(fits=int(sys.argv[1]) if len(sys.argv) > 1 else 200)
