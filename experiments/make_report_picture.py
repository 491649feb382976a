"""Takes the picture of the report in README: the demo, its report in a headless Chromium, the first screen.

Run `python experiments/make_report_picture.py`; it needs a Chromium or Chrome on the path.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from data_io.atomic import atomic_path
from identify import Scene, examples, fit
from identify.report import write_report

PICTURE = Path(__file__).resolve().parent.parent / "docs" / "report.png"
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome")
SIZE = (1100, 1150)  # pixels of the first screen


def main() -> int:
    """Write docs/report.png; exit code 2 without a browser."""
    browser = next((found for name in BROWSERS if (found := shutil.which(name))), None)
    if browser is None:
        print(f"no browser was found; install one of {', '.join(BROWSERS)}", file=sys.stderr)
        return 2
    with TemporaryDirectory() as scratch, atomic_path(PICTURE) as temporary:
        folder = Path(scratch)
        write_report(fit(Scene.from_toml(examples.SCENE)), folder)
        options = [
            "--headless",
            "--no-sandbox",
            "--hide-scrollbars",
            f"--user-data-dir={folder / 'browser'}",
            f"--window-size={SIZE[0]},{SIZE[1]}",
            f"--screenshot={temporary}",
        ]
        subprocess.run([browser, *options, (folder / "report.html").as_uri()], check=True, capture_output=True)
    print(f"{PICTURE.name}: {PICTURE.stat().st_size / 1e3:.0f} kB")
    return 0


if __name__ == "__main__":
    sys.exit(main())
