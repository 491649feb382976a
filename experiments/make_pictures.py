"""Takes the pictures of README and docs/app.md: the first screen of the demo's report, and one of its logs in the page.

python experiments/make_pictures.py                                 # needs a Chromium or Chrome on the path
python experiments/make_pictures.py --check stickslip-example-pair  # is README's picture that of this result?
"""

from __future__ import annotations

import re
import shutil
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

sys.path.insert(0, str(Path(__file__).parents[1]))

from PIL import Image, PngImagePlugin

from identify import Fit, Scene, examples, fit
from identify.app.folder import Folder
from identify.app.server import Serving
from identify.report.report_page import first_screen
from tests.support.browser import Browser

DOCS = Path(__file__).resolve().parents[1] / "docs"
REPORT, PAGE = (1100, 1150), (1280, 760)  # width and height [pixels]
BUTTONS = "[...document.querySelectorAll('nav a, #view button')].map((one) => one.lastChild.textContent).join(' ')"


def words(html: str) -> str:
    """The words of a page, without styles, numbers and marks."""
    text = re.sub(r"<style>.*?</style>|<[^>]+>|&\w+;", " ", html, flags=re.DOTALL)
    return " ".join(re.findall(r"[^\W\d_]{3,}", text))


def take(browser: Browser, name: str, height: int, html: str) -> None:
    """Take a picture of a page, which holds its words, so that CI sees when it is old."""
    browser.picture(DOCS / name, height)
    notes, image = PngImagePlugin.PngInfo(), Image.open(DOCS / name)
    notes.add_itxt("words", words(html))
    image.save(DOCS / name, pnginfo=notes)


def main() -> None:
    """Take both, or compare the first with a result."""
    if "--check" in sys.argv:
        now, before = (
            words(first_screen(Fit.load(sys.argv[2]).typed)),
            Image.open(DOCS / "report.png").info.get("words"),
        )
        if now != before:
            sys.exit(f"docs/report.png is old, run experiments/make_pictures.py; it shows: {before}; now: {now}")
        return
    with TemporaryDirectory() as folder, Browser() as browser:
        logs = Path(folder) / "my-logs"
        logs.mkdir()
        for item in (examples.SCENE, *examples.FOLDER.glob("*.txt.gz")):
            shutil.copy(item, logs)
        found = fit(Scene.from_toml(examples.SCENE), time_limit="5 min")
        browser.open(found.save(logs / "stickslip-example-pair"), REPORT[0])
        take(browser, "report.png", REPORT[1], first_screen(found.typed))
        serving = Serving(Folder.at(logs))
        serving.start()
        browser.size(*PAGE)
        browser.visit(serving.address + "#log?scene=pair.toml&number=2")
        browser.wait("document.querySelector('#view').dataset.seen && document.querySelector('#plots').dataset.drawn")
        browser.ask("document.getElementById('folder').textContent = 'my-logs'")
        take(browser, "app.png", PAGE[1], browser.ask(BUTTONS))
        serving.stop()


if __name__ == "__main__":
    main()
