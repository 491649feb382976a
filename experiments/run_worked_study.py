"""A worked study: three materials, eight volunteers, two sites, three speeds, from the logs to the page.

Draws the study, fits every group of logs, compares the materials and prints what was found beside what is true.
The folder holds the manifest, every fit and the pages: open report.html in it.

    python experiments/run_worked_study.py [folder] [volunteers]
"""

from __future__ import annotations

import csv
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from experiments.machine import describe
from experiments.study_drawn import CROSSED, MATERIALS, NAMES, PEOPLE, RIG, SITES, SPEEDS, Visit, visits, write_logs
from identify.base.errors import IdentifyError
from identify.effects import MAIN
from identify.identification import fit
from identify.report import write_report
from identify.scene import Scene
from identify.studies.compare import compare
from identify.studies.comparison_page import write_batch_report
from identify.studies.fits import read_fits
from identify.studies.labels import ComparisonQuestion


def fit_visit(visit: Visit, logs: Path, out: Path) -> list[object]:
    """Fit the logs of one visit together and write its report; returns its row of the index."""
    labels = {
        "material": visit.material,
        "volunteer": visit.volunteer,
        "site": visit.site,
        "order": str(visit.order),
        "hydration": str(visit.hydration),
    }
    document = {
        "name": visit.name,
        "effects": list(MAIN),
        "rig": dict(RIG),
        "logs": [
            {"path": f"{visit.name}_{k + 1}.csv", "drive_speed": speed, "labels": labels}
            for k, (speed, _, _) in enumerate(SPEEDS)
        ],
    }
    began = time.perf_counter()
    earlier = read_fits([out / visit.name]) if (out / visit.name / "result.json").is_file() else ()
    if earlier:
        return [visit.name, earlier[0].status, earlier[0].message, f"{visit.name}/result.json", *labels.values(), 0.0]
    try:
        found = fit(Scene.from_document(document, logs))
        write_report(found, out / visit.name)
        status, message, path = found.status.value, str(found.result["message"]), f"{visit.name}/result.json"
    except IdentifyError as error:
        status, message, path = "failed", str(error), ""
    seconds = round(time.perf_counter() - began, 2)
    return [visit.name, status, message, path, *labels.values(), seconds]


def fitted(folder: Path, drawn: list[Visit]) -> None:
    """All fits and the index of the batch; what is there already is kept."""
    rows = []
    for number, visit in enumerate(drawn, 1):
        row = fit_visit(visit, folder / "logs", folder)
        rows.append(row)
        print(f"{number:3d}/{len(drawn)} {visit.name:24s} {row[1]!s:18s} {row[-1]:6.2f} s", flush=True)
    with (folder / "index.csv").open("w", newline="", encoding="utf-8") as handle:
        writer = csv.writer(handle)
        writer.writerow(
            ["group", "status", "message", "result", *"material volunteer site order hydration".split(), "seconds"]
        )
        writer.writerows(rows)


def told(folder: Path, volunteers: int) -> None:
    """Pooled means beside the truth of an average person (geometric mean over the sites)."""
    comparison = compare(read_fits([folder]), ComparisonQuestion("material"))
    site = float(np.exp(np.mean(np.log(list(SITES.values())))))
    print(f"\n{'':12s}{'material':10s}{'truth':>10s}{'pooled':>10s}   95 % interval           of chance")
    for k, name in enumerate(NAMES):
        entry = next(q for q in comparison.quantities if q.quantity.name == name)
        if entry.pooled is None:
            print(f"{name:12s}{entry.reason}")
            continue
        for mean in sorted(entry.pooled.means, key=lambda m: list(MATERIALS).index(m.group)):
            true = MATERIALS[mean.group][k] * (site if k < 3 else 1.0)
            shown = entry.quantity.shown
            ends = "open" if mean.interval is None else "{:.4g} to {:.4g}".format(*map(shown, mean.interval))
            chance = np.hypot(PEOPLE[k], CROSSED[k]) / np.sqrt(volunteers)
            off = abs(np.log(shown(mean.value) / true)) / chance
            print(f"{name:12s}{mean.group:10s}{true:10.4g}{shown(mean.value):10.4g}   {ends:24s}{off:4.1f} sd")
        for d in entry.pooled.differences:
            print(f"{'':12s}{d.first} and {d.second}: {d.verdict}" + (f" ({d.reason})" if d.reason else ""))
    print("\nleft out:")
    for name, reason in comparison.taken.left_out:
        print(f"  {name}: {reason}")
    print("outliers: " + ", ".join(f"{o.name} in {o.quantity} ({o.z:+.1f} sd)" for o in comparison.odd))


def main(fast: bool = False, folder: Path | None = None, volunteers: int = 8) -> None:
    """The whole study; fast: one visit, nothing kept."""
    print(describe())
    with tempfile.TemporaryDirectory() as spare:
        out = Path(spare) if folder is None else folder
        (out / "logs").mkdir(parents=True, exist_ok=True)
        drawn = visits(volunteers)
        if fast:
            drawn = drawn[:1]
        write_logs(out / "logs", drawn)
        fitted(out, drawn)
        if fast:
            print(f"{len(read_fits([out]))} fits")
            return
        told(out, volunteers)
        began = time.perf_counter()
        page = write_batch_report(out)
        print(f"\npage: {page} ({page.stat().st_size / 1e6:.2f} MB, {time.perf_counter() - began:.1f} s)")


if __name__ == "__main__":
    main(
        folder=Path(sys.argv[1]) if len(sys.argv) > 1 else Path("worked-study"),
        volunteers=int(sys.argv[2]) if len(sys.argv) > 2 else 8,
    )
