"""docs/notebook.ipynb, executed with its outputs: `python experiments/make_notebook.py`.

Needs nbclient and ipykernel (`pip install nbclient ipykernel`), which nothing else here does; a test runs the same
cells and holds the numbers of the page to them.
"""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "notebook.ipynb"
SOURCE = """
# %% [markdown]
# Two logs to friction parameters

Made by `python experiments/make_notebook.py`. The logs ship with the package and are simulated, so the truth is known:
mu_s 0.62, mu_k0 0.43, delta_mu_k −0.13, a 300 s/m, D 37.4 µm, t_cr 0.5 s. With your own, give their paths instead.
# %%
from data_io import read_log
from identify import Fit, ProgressBar, Scene, examples, fit, simulate

slow, fast = (examples.FOLDER / f"{speed}.txt.gz" for speed in ("0.1_mm_per_s", "5_mm_per_s"))
read_log(fast).plot()
# %% [markdown]
A scene is what was measured and how; no file is needed. Every quantity is text with a unit, or a number in SI.
# %%
scene = Scene.from_document(
    {
        "effects": ["inertia", "hysteresis_damping", "contact_ageing", "velocity_weakening", "varying_normal_force"],
        "rig": {"mass": "200 g", "stiffness": "1.47 N/mm", "damping": "147 N/m"},
        "logs": [{"path": slow, "drive_speed": "0.1 mm/s"}, {"path": fast, "drive_speed": "5 mm/s"}],
    }
)
found = fit(scene, progress=ProgressBar())
found
# %% [markdown]
Printed, the same object shows its summary.
# %%
print(found)
# %% [markdown]
Its tables are data frames, in SI.
# %%
found.parameters[["value", "lower", "upper", "unit", "verdict"]]
# %%
found.classical[["drive_speed_m_per_s", "cycles", "static_peak_coefficient", "drop_N", "frequency_Hz"]]
# %%
found.cycles.head(3)
# %%
found.plot(log=2)
# %% [markdown]
What the pair does elsewhere, at another drive speed or load, with 95 % intervals.
# %%
there = found.predict(drive_speed="1 mm/s")
there
# %%
there.to_frame()
# %%
found.simulate("2 s", drive_speed="1 mm/s").to_frame("1 kHz").tail(3)
# %% [markdown]
A scene is simulated without a fit too, with the values that stand in it, else the documented defaults.
# %%
simulate(scene, "2 s", drive="5 mm/s", normal_force="1 N").plot()
# %% [markdown]
`save` writes report.html, result.json, classical.csv, result.h5 and figures; a stored fit is read again.
# %%
found.save("two-logs")
Fit.from_json("two-logs/result.json").parameters["verdict"]
"""


def notebook() -> dict[str, Any]:
    """The notebook without outputs, nbformat 4."""
    cells: list[dict[str, Any]] = []
    for number, part in enumerate(SOURCE.split("\n# %%")[1:]):
        head, _, source = part.partition("\n")
        kind = "markdown" if "markdown" in head else "code"
        cell: dict[str, Any] = {"cell_type": kind, "id": f"cell-{number}", "metadata": {}, "source": source.strip()}
        cells.append(cell | ({"execution_count": None, "outputs": []} if kind == "code" else {}))
    kernel = {"display_name": "Python 3", "language": "python", "name": "python3"}
    return {"cells": cells, "metadata": {"kernelspec": kernel}, "nbformat": 4, "nbformat_minor": 5}


def main() -> None:
    """Execute the cells in a kernel, in a folder that is thrown away, and write the page."""
    import tempfile

    import nbformat
    from nbclient import NotebookClient

    os.environ["PYTHONPATH"] = str(ROOT)
    made = nbformat.from_dict(notebook())
    with tempfile.TemporaryDirectory() as folder:
        NotebookClient(made, timeout=None, resources={"metadata": {"path": folder}}).execute()
    for cell in made.cells:
        cell.metadata.pop("execution", None)  # times of the run
    made.metadata.pop("language_info", None)
    PAGE.write_text(json.dumps(made, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main())
