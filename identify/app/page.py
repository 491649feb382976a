"""What the page asks of the server, each with one method: from plain values to plain values."""

from __future__ import annotations

import csv
import io
import shutil
import threading
from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data_io.atomic import atomic_write
from identify import examples
from identify.app.commands import words_of
from identify.app.curves import OpenLogs
from identify.app.folder import Folder, PageError
from identify.app.jobs import Jobs
from identify.app.looks import Looks, row_of, seen_by_a_fit
from identify.app.points import answer_at, axes_of, site_of
from identify.app.results import batch_seen, fit_row, fit_seen, residuals
from identify.app.scenes import Scenes, edited, scene_of, with_log
from identify.app.tries import TriedCycles, costs, start_from_data, tried
from identify.logs.segmented import Segmented, segmented
from identify.report.stored_result import read_result
from identify.report.stored_result import scene_of as scene_of_result
from identify.scene import Scene
from identify.scene.values import LogEntry

Asked = Mapping[str, Any]
REMEMBERED = 16  # cut logs and scenes of results


class Page:
    """One folder, and everything the page can do in it."""

    def __init__(self, folder: Folder) -> None:
        self.folder = folder
        self.jobs, self.looks, self.logs, self.scenes = Jobs(folder), Looks(folder), OpenLogs(folder), Scenes(folder)
        self._cut: OrderedDict[tuple[Any, ...], Segmented] = OrderedDict()
        self._lock = threading.Lock()

    # ---- the folder, its jobs and results ----------------------------------------------------------------------------

    def list_folder(self, asked: Asked) -> dict[str, Any]:
        """Logs with what is in them, scenes, fits, batches and jobs."""
        found = self.folder.found()
        logs = [row_of(name, self.folder.path(name).stat().st_size, self.looks.of(name)) for name in found.logs]
        return {
            "folder": str(self.folder.root),
            "logs": logs,
            "scenes": list(found.scenes),
            "rigs": list(found.rigs),
            "fits": [fit_row(self.folder, name) for name in found.fits],
            "batches": list(found.batches),
            "jobs": self.jobs.listed(),
        }

    def list_jobs(self, asked: Asked) -> dict[str, Any]:
        """The jobs alone."""
        return {"jobs": self.jobs.listed()}

    def start_job(self, asked: Asked) -> dict[str, Any]:
        """Start a command as a job."""
        words, out = words_of(self.folder, asked)
        return self.jobs.start(words, out)

    def cancel_job(self, asked: Asked) -> dict[str, Any]:
        """End a job."""
        return self.jobs.cancel(_text(asked, "id"))

    def job_document(self, asked: Asked) -> dict[str, Any]:
        """What a job printed."""
        return self.jobs.document(_text(asked, "id"))

    def see_fit(self, asked: Asked) -> dict[str, Any]:
        """A finished fit."""
        return fit_seen(self.folder, _text(asked, "path"))

    def see_batch(self, asked: Asked) -> dict[str, Any]:
        """A batch, running or finished."""
        return batch_seen(self.folder, _text(asked, "path"))

    def see_residuals(self, asked: Asked) -> NDArray[np.float64]:
        """Curves of a fit in a window."""
        begin, end = _number(asked, "begin", -np.inf), _number(asked, "end", np.inf)
        return residuals(self.folder, _text(asked, "path"), _whole(asked, "number", 1), begin, end)

    def put_examples(self, asked: Asked) -> dict[str, Any]:
        """Copy the example logs and their scene into the folder; what is there already stays."""
        for item in sorted(examples.FOLDER.iterdir()):
            if item.suffix in (".gz", ".toml") and not (self.folder.root / item.name).exists():
                shutil.copyfile(item, self.folder.root / item.name)
        return {}

    def write_manifest(self, asked: Asked) -> dict[str, Any]:
        """Write the manifest of a batch: rows of path, group, drive_speed and labels."""
        path, rows = self.folder.path(asked.get("path")), asked.get("rows")
        if path.suffix != ".csv" or (path.exists() and not _is_manifest(path)):
            raise PageError(f"{asked.get('path')} is no manifest; choose a new name that ends in .csv")
        if not isinstance(rows, list) or not rows or not all(isinstance(row, dict) for row in rows):
            raise PageError("no logs were chosen; mark some in the table of logs")
        names = list(dict.fromkeys(["path", "group", *(key for row in rows for key in row)]))
        text = io.StringIO()
        writer = csv.DictWriter(text, names, restval="")
        writer.writeheader()
        for row in rows:
            self.folder.file(row.get("path"))
            writer.writerow({key: str(value) for key, value in row.items()})
        with atomic_write(path) as handle:
            handle.write(text.getvalue())
        return {"path": self.folder.name(path)}

    def see_manifest(self, asked: Asked) -> dict[str, Any]:
        """The rows of a manifest that the page has written; none where there is no such file."""
        path = self.folder.path(asked.get("path"))
        if not path.is_file() or not _is_manifest(path):
            return {"rows": []}
        return {"rows": list(csv.DictReader(io.StringIO(path.read_text(encoding="utf-8"))))}

    # ---- one log -----------------------------------------------------------------------------------------------------

    def open_log(self, asked: Asked) -> dict[str, Any]:
        """Whether a log is in memory, what is in it, and where it stands in a scene."""
        name, options, entry = self._named(asked)
        opened = self.logs.opened(name, options)
        seen = self.looks.of(name, waited_for=True)
        about: dict[str, Any] = {
            "path": name,
            "share": opened.share,
            "error": opened.error,
            "ready": opened.record is not None,
        }
        if opened.record is None:
            return about
        about |= {
            "rows": len(opened.record),
            "duration": float(opened.record.time[-1]),
            "has_speed": bool(opened.programme),
            "inspection": seen if entry is None else None,
            "cut": None if entry is None else self._cut_words(entry),
        }
        return about

    def see_curves(self, asked: Asked) -> NDArray[np.float64]:
        """Curves of a window of a log."""
        name, options, _ = self._named(asked)
        return self.logs.opened(name, options).window(_number(asked, "begin", 0.0), _number(asked, "end", np.inf))

    def see_cut(self, asked: Asked) -> dict[str, Any]:
        """A log of a scene as a fit with its cuts sees it."""
        return seen_by_a_fit(self._segmented(self._scene(asked), self._log_number(asked)))

    # ---- scenes ------------------------------------------------------------------------------------------------------

    def see_scene(self, asked: Asked) -> dict[str, Any]:
        """A scene: text, form, what is wrong."""
        return self.scenes.seen(_text(asked, "path"))

    def edit_scene(self, asked: Asked) -> dict[str, Any]:
        """Put a text, some fields, or a log into the draft of a scene."""
        name = _text(asked, "path")
        text = asked["text"] if isinstance(asked.get("text"), str) else self.scenes.text(name)
        for change in asked.get("changes") or []:
            text = edited(text, change["keys"], change["value"])
        for log in asked.get("logs") or []:
            self.folder.file(log)
            text = with_log(text, log)
        self.scenes.keep(name, text)
        return self.scenes.seen(name)

    def save_scene(self, asked: Asked) -> dict[str, Any]:
        """Write the draft to the file."""
        name = _text(asked, "path")
        self.scenes.save(name)
        return self.scenes.seen(name)

    def try_values(self, asked: Asked) -> dict[str, Any]:
        """Simulate some cycles of a log with other values."""
        scene, number = self._scene(asked), self._log_number(asked)
        log = self._segmented(scene, number)
        values = {str(key): float(value) for key, value in (asked.get("values") or {}).items()}
        stretch = TriedCycles(_whole(asked, "first", 0), _whole(asked, "count", 8))
        return tried(scene, scene.logs[number], log, values, stretch)

    def effect_costs(self, asked: Asked) -> dict[str, Any]:
        """What each effect, and what other accuracies cost in a simulation."""
        scene = self._scene(asked)
        if not scene.logs:
            raise PageError("the scene lists no log to simulate; add one")
        return costs(scene, scene.logs[min(self._log_number(asked), len(scene.logs) - 1)])

    def start_values(self, asked: Asked) -> dict[str, Any]:
        """What a fit would start from."""
        return start_from_data(self._scene(asked))

    # ---- maps --------------------------------------------------------------------------------------------------------

    def see_point(self, asked: Asked) -> dict[str, Any]:
        """The quantities of a map, and the answer at an operating point."""
        result = None
        if asked.get("fit"):
            path = self.folder.path(asked["fit"]) / "result.json"
            result = read_result(path)
            scene = scene_of_result(result, path)
        else:
            scene = self._scene(asked)
        site = site_of(scene, result, self._log_number(asked))
        changes = {str(key): float(value) for key, value in (asked.get("changes") or {}).items()}
        return {"axes": axes_of(site), **answer_at(site, result, changes)}

    # ---- what several of these need ----------------------------------------------------------------------------------

    def _scene(self, asked: Asked) -> Scene:
        name = _text(asked, "scene")
        return scene_of(self.scenes.text(name), self.folder.path(name))

    def _log_number(self, asked: Asked) -> int:
        return _whole(asked, "number", 0)

    def _named(self, asked: Asked) -> tuple[str, dict[str, Any], LogEntry | None]:
        """Path, reading options and entry of a log: one of a scene by its number, or a file by its path."""
        if not asked.get("scene"):
            return _text(asked, "path"), {}, None
        return self._listed(self._scene(asked), self._log_number(asked))

    def _listed(self, scene: Scene, number: int) -> tuple[str, dict[str, Any], LogEntry]:
        """The same of a log of a scene."""
        if not 0 <= number < len(scene.logs):
            raise PageError(f"the scene has {len(scene.logs)} logs; choose one of them")
        entry = scene.logs[number]
        try:
            name = self.folder.name(entry.path.resolve())
        except ValueError:
            raise PageError(
                f"{entry.path.name} of the scene lies outside the folder; copy it into the folder"
            ) from None
        load = entry.normal_force if entry.normal_force is not None else scene.rig.normal_force
        said = {"step": entry.step, "run": entry.run, "rate": entry.rate, "normal_force": load,
                "columns": dict(entry.columns or {}) or None, "units": dict(entry.units or {}) or None}  # fmt: skip
        options = {key: value for key, value in said.items() if value is not None}
        return name, options, entry

    def _segmented(self, scene: Scene, number: int) -> Segmented:
        """A log of the scene, cut and segmented; kept while its file and the scene stay as they are."""
        name, options, entry = self._listed(scene, number)
        rig = scene.rig_for(entry)
        record = self.logs.wait(name, options)
        key = (name, id(record), repr(entry), repr(rig))
        with self._lock:
            if key in self._cut:
                self._cut.move_to_end(key)
                return self._cut[key]
        if rig.drive_speed is None:
            rig = replace(rig, drive_speed=self.logs.opened(name, options).programme or None)
        made = segmented(entry, record, rig)
        with self._lock:
            self._cut[key] = made
            while len(self._cut) > REMEMBERED:
                self._cut.popitem(last=False)
        return made

    def _cut_words(self, entry: LogEntry) -> dict[str, Any]:
        tare = list(entry.tare) if isinstance(entry.tare, tuple) else None
        return {
            "window": None if entry.window is None else list(entry.window),
            "exclude": [list(span) for span in entry.exclude],
            "skip_cycles": entry.skip_cycles,
            "tare": tare,
        }


def _text(asked: Asked, key: str) -> str:
    value = asked.get(key)
    if not isinstance(value, str) or not value:
        raise PageError(f"the page did not say {key}; load it again")
    return value


def _number(asked: Asked, key: str, otherwise: float) -> float:
    try:
        return float(asked.get(key, otherwise))
    except (TypeError, ValueError):
        raise PageError(f"{key} is no number; load the page again") from None


def _whole(asked: Asked, key: str, otherwise: int) -> int:
    number = _number(asked, key, otherwise)
    if not abs(number) < 1e9:
        raise PageError(f"{key} is no number of anything; load the page again")
    return int(number)


def _is_manifest(path: Any) -> bool:
    with path.open(encoding="utf-8", errors="replace") as handle:
        return str(handle.readline(10_000)).startswith("path,group")
