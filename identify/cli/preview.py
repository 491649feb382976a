"""`stickslip fit --preview`: the detected cycles and the start trajectory over the data, before anything is fitted."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from identify.cli.common import Answer, Terminal, file_to_write

if TYPE_CHECKING:
    from identify.scene import Scene


def preview_file(out: Path) -> Path:
    """The picture stands beside the folder of the result: "DIR-preview.png".

    Raises:
        CommandLineError: it cannot be written there.
    """
    return file_to_write(str(out.parent / f"{out.name}-preview.png"), "--preview")


def run_preview(scene: Scene, out: Path, terminal: Terminal) -> Answer:
    """Draw and say what a fit would start from.

    Raises:
        SceneError, FitError, LogError, CommandLineError, OSError: one sentence each.
    """
    from data_io.atomic import atomic_path
    from identify.base.wording import columns, quantity, wrapped
    from identify.cli.progress import Progress
    from identify.diagnosis.selection import LOOKED_AT
    from identify.estimation.preview import preview
    from identify.logs.scene_records import with_drives, with_records
    from identify.report.force_figure import draw_preview
    from identify.report.style import drawing_style
    from identify.scene.variant import scene_with

    file = preview_file(out)
    with Progress(terminal.notes, terminal.progress) as progress:
        progress("reading the logs", 0.0)
        scene, drives = with_drives(scene)
        scene, records = with_records(scene, None)
        if scene.effects == "auto":
            scene = scene_with(scene, LOOKED_AT, {})
        progress("finding a start", 0.3)
        seen = preview(scene, records)
        progress("drawing", 0.8)
        with drawing_style(), atomic_path(file) as temporary:
            draw_preview(seen).savefig(temporary, format="png", dpi=130)
    for sentence in (*seen.notices, *drives):
        terminal.say(wrapped(sentence))
    for log in seen.logs:
        terminal.say(wrapped(f"{log.name}: {log.told}"))
    terminal.say(f"the start: {seen.source}")
    rows = [["", "value"], *([name, quantity(value, seen.units[name])] for name, value in seen.parameters.items())]
    terminal.say(columns(rows))
    terminal.say(f"picture: {file}")
    return Answer(
        document={
            "status": "preview",
            "message": "nothing was fitted; the picture shows the cycles detected and the start over the data",
            "picture": str(file),
            "source": seen.source,
            "start": {name: {"value": v, "unit": seen.units[name]} for name, v in seen.parameters.items()},
            "logs": [{"name": log.name, "cycles": int(log.onset.size), "text": log.told} for log in seen.logs],
        }
    )
