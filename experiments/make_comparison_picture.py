"""Takes the picture of the comparison in README: the page of a finished worked study in a headless Chromium.

Run `python experiments/run_worked_study.py FOLDER`, then `python experiments/make_comparison_picture.py FOLDER`; it
needs a Chromium or Chrome on the path.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from data_io.atomic import atomic_path

PICTURE = Path(__file__).resolve().parent.parent / "docs" / "comparison.png"
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome")
SIZE = (1100, 1500)  # pixels


def main(folder: Path) -> int:
    """Write docs/comparison.png; exit code 2 without a browser or a page."""
    browser = next((found for name in BROWSERS if (found := shutil.which(name))), None)
    page = folder / "report.html"
    if browser is None or not page.is_file():
        print(f"no browser or no {page}; install one of {', '.join(BROWSERS)}, run the study", file=sys.stderr)
        return 2
    with TemporaryDirectory() as scratch, atomic_path(PICTURE) as temporary:
        options = [
            "--headless",
            "--no-sandbox",
            "--hide-scrollbars",
            f"--user-data-dir={Path(scratch) / 'browser'}",
            f"--window-size={SIZE[0]},{SIZE[1]}",
            f"--screenshot={temporary}",
        ]
        subprocess.run([browser, *options, page.resolve().as_uri()], check=True, capture_output=True)
    print(f"{PICTURE.name}: {PICTURE.stat().st_size / 1e3:.0f} kB")
    return 0


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit("expected the folder of a worked study: make_comparison_picture.py FOLDER")
    sys.exit(main(Path(sys.argv[1])))
