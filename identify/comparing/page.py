"""report.html of a batch: one file that opens from disk, sorts its tables itself and asks the network for nothing."""

from __future__ import annotations

import os
from pathlib import Path
from urllib.parse import quote

from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from data_io.atomic import atomic_write
from identify.comparing.fits import PAGE, read_fits


def write_batch_report(directory: str | Path) -> Path:
    """Write DIR/report.html over the fits of a batch folder; returns its path. OSError where it cannot be written."""
    directory = Path(directory)
    entries = read_fits([directory])
    environment = Environment(
        loader=ChoiceLoader(
            [PackageLoader("identify.comparing", "templates"), PackageLoader("identify.report", "templates")]
        ),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=StrictUndefined,
    )
    text = environment.get_template("batch.html.j2").render(
        style=Markup(environment.get_template("style.css").render()),
        title=directory.resolve().name,
        fits=[(entry, _link(entry.folder / PAGE, directory)) for entry in entries],
    )
    path = directory / PAGE
    with atomic_write(path) as handle:
        handle.write(text)
    return path


def _link(page: Path, folder: Path) -> str:
    """The address of a fit's page from a page in `folder`; empty where there is none."""
    return quote(Path(os.path.relpath(page, folder)).as_posix()) if page.is_file() else ""
