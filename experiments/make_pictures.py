"""Takes the pictures of README and docs/app.md: the first screen of the demo's report, and one of its logs in the page.

Run `python experiments/make_pictures.py`; it needs a Chromium or Chrome on the path.
"""

from __future__ import annotations

import shutil
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

sys.path.insert(0, str(Path(__file__).parents[1]))

from identify import Scene, examples, fit
from identify.app.folder import Folder
from identify.app.server import Serving
from identify.report import write_report
from tests.support.browser import Browser

DOCS = Path(__file__).resolve().parent.parent / "docs"
REPORT, PAGE = (1100, 1150), (1280, 760)  # width and height [pixels]
LOG = "#log?scene=pair.toml&number=2"


def main() -> None:
    """Write docs/report.png and docs/app.png."""
    with TemporaryDirectory() as folder, Browser() as browser:
        logs = Path(folder) / "my-logs"
        logs.mkdir()
        for item in (examples.SCENE, *examples.FOLDER.glob("*.txt.gz")):
            shutil.copy(item, logs)
        scene = Scene.from_toml(examples.SCENE)
        write_report(fit(scene), logs / f"stickslip-{scene.name}")
        browser.open(logs / f"stickslip-{scene.name}" / "report.html", REPORT[0])
        browser.picture(DOCS / "report.png", REPORT[1])
        serving = Serving(Folder.at(logs))
        serving.start()
        browser.size(*PAGE)
        browser.visit(serving.address + LOG)
        browser.wait(
            "document.querySelector('#view').dataset.seen === 'yes' && document.querySelector('#plots').dataset.drawn"
        )
        browser.ask("document.getElementById('folder').textContent = 'my-logs'")
        browser.picture(DOCS / "app.png", PAGE[1])
        serving.stop()


if __name__ == "__main__":
    main()
