"""Takes the picture of the report in README: the demo, its report in a headless Chromium, the first screen.

Run `python experiments/make_report_picture.py`; it needs a Chromium or Chrome on the path.
"""

from __future__ import annotations

import sys
from pathlib import Path
from tempfile import TemporaryDirectory

sys.path.insert(0, str(Path(__file__).parents[1]))

from identify import Scene, examples, fit
from identify.report import write_report
from tests.support.browser import Browser

PICTURE = Path(__file__).resolve().parent.parent / "docs" / "report.png"
WIDTH, HEIGHT = 1100, 1150  # pixels of the first screen


def main() -> None:
    """Write docs/report.png."""
    with TemporaryDirectory() as folder, Browser() as browser:
        write_report(fit(Scene.from_toml(examples.SCENE)), Path(folder))
        browser.open(Path(folder) / "report.html", WIDTH)
        browser.picture(PICTURE, HEIGHT)
    print(f"{PICTURE.name}: {PICTURE.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main()
