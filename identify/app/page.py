"""What the page asks of the server: one answer per question, from plain values to plain values."""

from __future__ import annotations

import csv
import io
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from starlette.responses import Response

from data_io.atomic import atomic_write
from identify import examples
from identify.app.curves import OpenLogs
from identify.app.folder import Document, Folder, PageError, PageQuery
from identify.app.jobs import Jobs, words_of
from identify.app.looks import Looks, classical_shown, row_of, seen_by_a_fit
from identify.app.results import batch_seen, fit_picture, fit_row, fit_seen, residuals
from identify.app.scenes import Scenes, edited, with_log
from identify.app.simulations import answer_at, axes_of, site_at, start_from_data, tried
from identify.base.errors import SceneError
from identify.logs.prepare import Segmented, segmented
from identify.logs.scene_records import reading_options
from identify.report.stored_result import read_result
from identify.report.stored_result import scene_of as scene_of_result
from identify.scene import Scene
from identify.scene.values import LogEntry

Answer = Document | NDArray[np.float64] | Response


class Page:
    """One folder, and everything the page can do in it; `answers`: by name, the method of HTTP and the work."""

    def __init__(self, folder: Folder) -> None:
        self.folder = folder
        self.jobs, self.looks, self.logs, self.scenes = Jobs(folder), Looks(folder), OpenLogs(folder), Scenes(folder)
        self._cut: tuple[tuple[str, ...], Segmented | None] = (), None
        self.answers: dict[str, tuple[str, Callable[[PageQuery], Answer]]] = {
            "folder": ("GET", lambda _: self._listed()),
            "job": ("GET", lambda q: self.jobs.document(q.text("id"))),
            "start": ("POST", lambda q: self.jobs.start(*words_of(folder, q.values))),
            "cancel": ("POST", lambda q: self.jobs.cancel(q.text("id"))),
            "fit": ("GET", lambda q: fit_seen(folder, q.text("path"))),
            "batch": ("GET", lambda q: batch_seen(folder, q.text("path"))),
            "picture": ("GET", lambda q: fit_picture(folder, q.text("path"), q)),
            "residuals": ("GET", lambda q: residuals(folder, q.text("path"), q.whole("number", 1), *self._span(q))),
            "examples": ("POST", lambda _: self._put_examples()),
            "manifest": ("POST", self._write_manifest),
            "groups": ("GET", lambda q: {"rows": self._rows(folder.path(q.values.get("path")))}),
            "log": ("GET", self._open_log),
            "curves": ("GET", lambda q: self.logs.opened(*self._named(q)[:2]).window(*self._span(q))),
            "cut": ("GET", lambda q: seen_by_a_fit(self._segmented(self._scene(q), q.whole("number", 0)))),
            "scene": ("GET", lambda q: self.scenes.seen(q.text("path"))),
            "edit": ("POST", self._edit),
            "save": ("POST", lambda q: self.scenes.save(q.text("path"))),
            "try": ("POST", self._try),
            "start-values": ("POST", lambda q: start_from_data(self._scene(q))),
            "point": ("POST", self._point),
        }

    # ---- the folder, its results and manifests -----------------------------------------------------------------------

    def _listed(self) -> Document:
        """Logs with what is in them, scenes, fits, batches and jobs."""
        found = self.folder.found()
        logs = [row_of(name, self.looks.of(name)) for name in found["logs"]]
        fits = [fit_row(self.folder, name) for name in found["fits"]]
        return found | {"folder": str(self.folder.root), "logs": logs, "fits": fits, "jobs": self.jobs.listed()}

    @staticmethod
    def _span(query: PageQuery) -> tuple[float, float]:
        return query.read("begin", float, -np.inf), query.read("end", float, np.inf)

    def _put_examples(self) -> Document:
        """Copy the example logs and their scene into the folder; what is there already stays."""
        for item in sorted(examples.FOLDER.iterdir()):
            if item.suffix in (".gz", ".toml") and not (self.folder.root / item.name).exists():
                shutil.copyfile(item, self.folder.root / item.name)
        return {}

    def _write_manifest(self, query: PageQuery) -> Document:
        """Write the manifest of a batch: rows of path, group, drive_speed and labels."""
        path, rows = self.folder.path(query.values.get("path")), query.values.get("rows")
        if path.suffix != ".csv" or (path.exists() and not self._rows(path)):
            raise PageError(f"{path.name} is no manifest; choose a new name that ends in .csv")
        if not isinstance(rows, list) or not rows or not all(isinstance(row, dict) for row in rows):
            raise PageError("no logs were chosen; mark some in the table of logs")
        text = io.StringIO()
        names = dict.fromkeys(["path", "group", *(key for row in rows for key in row)])
        writer = csv.DictWriter(text, list(names), restval="")
        writer.writeheader()
        for row in rows:
            self.folder.file(row.get("path"))
            writer.writerow({key: str(value) for key, value in row.items()})
        with atomic_write(path) as handle:
            handle.write(text.getvalue())
        return {"path": self.folder.name(path)}

    @staticmethod
    def _rows(path: Path) -> list[dict[str, str]]:
        """Rows of a manifest that the page has written; none of any other file."""
        text = path.read_text(encoding="utf-8", errors="replace") if path.is_file() else ""
        return list(csv.DictReader(io.StringIO(text))) if text.startswith("path,group") else []

    # ---- one log -----------------------------------------------------------------------------------------------------

    def _open_log(self, query: PageQuery) -> Document:
        """Whether a log is in memory, what is in it, and where it stands in a scene."""
        name, options, entry = self._named(query)
        opened, seen = self.logs.opened(name, options), self.looks.of(name, waited_for=True)
        ready = opened.record is not None
        about: Document = {"path": name, "share": opened.share, "error": opened.error, "ready": ready}
        if opened.record is None:
            return about
        cut: Document = {key: getattr(entry, key) for key in ("window", "exclude", "skip_cycles") if entry}
        if entry is not None:
            cut["tare"] = entry.tare if isinstance(entry.tare, tuple) else None
        return about | {
            "rows": len(opened.record),
            "duration": float(opened.record.time[-1]),
            "has_speed": bool(opened.programme),
            "inspection": seen if entry is None else None,
            "classical": classical_shown(seen["classical"]["rows"]) if seen and "classical" in seen else None,
            "cut": cut or None,
        }

    # ---- scenes, simulations and maps --------------------------------------------------------------------------------

    def _edit(self, query: PageQuery) -> Document:
        """Put a text, some fields, or logs into the draft of a scene."""
        name, text = query.text("path"), query.values.get("text")
        text = text if isinstance(text, str) else self.scenes.text(name)
        for change in query.read("changes", list, ()):
            if not isinstance(change, dict) or not isinstance(change.get("keys"), list):
                raise PageError("a change of a scene has keys and a value; load the page again")
            text = edited(text, change["keys"], change.get("value"))
        for log in query.read("logs", list, ()):
            self.folder.file(log)
            text = with_log(text, log)
        return self.scenes.keep(name, text)

    def _try(self, query: PageQuery) -> Document:
        """Simulate some cycles of a log with other values."""
        scene, number = self._scene(query), query.whole("number", 0)
        log = self._segmented(scene, number)
        cycles = range(first := max(query.whole("first", 0), 0), first + max(query.whole("count", 8), 1))
        return tried(scene, log, query.numbers("values"), cycles)

    def _point(self, query: PageQuery) -> Document:
        """The quantities of a map, and the answer at an operating point."""
        result, scene = None, None
        if query.values.get("fit"):
            path = self.folder.path(query.values["fit"]) / "result.json"
            result = read_result(path)
            scene = scene_of_result(result, path)
        scene = scene or self._scene(query)
        try:
            site = site_at(scene, result, query.whole("number", 0))
        except (PageError, SceneError) as error:  # an answer: which number is missing for a map
            return {"missing": str(error)}
        return {"axes": axes_of(site), **answer_at(site, result, query.numbers("changes"))}

    # ---- what several of these need ----------------------------------------------------------------------------------

    def _scene(self, query: PageQuery) -> Scene:
        return self.scenes.scene(query.text("scene"))

    def _named(self, query: PageQuery) -> tuple[str, Document, LogEntry | None]:
        """Path, reading options and entry of a log: one of a scene by its number, or a file by its path."""
        if not query.values.get("scene"):
            return query.text("path"), {}, None
        return self._of_scene(self._scene(query), query.whole("number", 0))

    def _of_scene(self, scene: Scene, number: int) -> tuple[str, Document, LogEntry]:
        """The same of a log of a scene."""
        if not 0 <= number < len(scene.logs):
            raise PageError(f"the scene has {len(scene.logs)} logs; choose one of them")
        entry = scene.logs[number]
        try:
            name = self.folder.name(entry.path.resolve())
        except ValueError:
            sentence = f"{entry.path.name} of the scene lies outside the folder; copy it into the folder"
            raise PageError(sentence) from None
        load = entry.normal_force if entry.normal_force is not None else scene.rig.normal_force
        options = {**reading_options(scene, entry), "normal_force": load}
        return name, {key: value for key, value in options.items() if value is not None}, entry

    def _segmented(self, scene: Scene, number: int) -> Segmented:
        """A log of the scene, cut and segmented; kept while its file and the scene stay as they are."""
        name, options, entry = self._of_scene(scene, number)
        rig, record = scene.rig_for(entry), self.logs.wait(name, options)
        key = (name, str(id(record)), repr(entry), repr(rig))
        known, made = self._cut  # of the log that is worked on
        if known == key and made is not None:
            return made
        if rig.drive_speed is None:
            rig = replace(rig, drive_speed=self.logs.opened(name, options).programme or None)
        made = segmented(entry, record, rig)
        self._cut = key, made
        return made
