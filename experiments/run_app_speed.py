"""How fast the page is: first picture, pan and zoom of ten million samples, and the try sliders, in headless Chromium.

Prints a table. Needs the extra `app` and Chromium. python experiments/run_app_speed.py [samples]
"""

import resource
import sys
import tempfile
import time
from pathlib import Path
from statistics import median

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from data_io import Record, write_hdf5
from identify.app.folder import Folder
from identify.app.server import Serving
from tests.app.browser import PageBrowser
from tests.support.browser import CHROMIUM

TURNS = 50
RATE = 2000.0  # [Hz]
STARTED = 4.0  # seconds after which a fit is at work


def long_log(path: Path, samples: int) -> None:
    """A saw-tooth force under a steady load, with noise."""
    time_, rng = np.arange(samples) / RATE, np.random.default_rng(1)
    force = 0.3 + 0.2 * (time_ % 0.3) / 0.3 + rng.normal(0.0, 0.005, samples)
    load = 1.0 + rng.normal(0.0, 0.003, samples)
    write_hdf5(Record(time_, load, force), path)


def waited(browser: PageBrowser, counter: str, act: str) -> float:
    """Milliseconds from an act in the page until what it shows was drawn, the next frame included."""
    return float(
        browser.ask(
            f"(async () => {{ const before = Number({counter} ?? 0), began = performance.now(); {act};"
            f"while (Number({counter} ?? 0) <= before) await new Promise(requestAnimationFrame);"
            "return performance.now() - began; })()"
        )
    )


def curves_of(browser: PageBrowser, serving: Serving, name: str, turns: int) -> None:
    """First picture, pan and zoom of one log."""
    opened = serving.page.logs.opened(name)
    began = time.perf_counter()
    while opened.record is None and not opened.error:
        time.sleep(0.01)
    print(f"reading {len(opened.record or ()):,} samples  {time.perf_counter() - began:8.2f} s")
    began = time.perf_counter()
    browser.visit(f"{serving.address}#log?path={name}&alone=1")
    browser.wait("Number(document.querySelector('#plots').dataset.drawn) > 0")
    print(f"first picture after reading  {time.perf_counter() - began:8.2f} s (the page opened anew)")
    drawn, view = "document.querySelector('#plots').dataset.drawn", "document.querySelector('#view').timeView"
    browser.wait(f"{view}")
    zooms, pans = [], []
    for turn in range(turns):
        share = 0.9 ** (turn % 25)
        zooms.append(waited(browser, drawn, f"{view}.go({view}.begin, {view}.begin + {view}.whole[1] * {share})"))
        step = f"0.1 * ({view}.end - {view}.begin)"
        pans.append(waited(browser, drawn, f"{view}.go({view}.begin + {step}, {view}.end + {step})"))
    longest = max(zooms + pans)
    print(f"median of {turns}: zoom  {median(zooms):8.1f} ms;  pan {median(pans):8.1f} ms (longest {longest:.0f} ms)")
    points = browser.ask(f"{view}.rows[0].length")
    heap = browser.call("Runtime.getHeapUsage")["usedSize"]
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"points a curve {points};  page {heap / 1e6:.0f} MB of JavaScript")
    print(f"server at most {peak:.0f} MB, the writing of the log included")


def sliders_of(browser: PageBrowser, serving: Serving, turns: int) -> None:
    """From a slider to the curve, for the demo's log at 1 mm/s."""
    browser.visit(f"{serving.address}#try?scene=pair.toml&number=2")
    browser.wait("document.querySelector('#view').dataset.tried")
    slider = "document.querySelector('[data-parameter=mu_s]')"
    tries = [
        waited(
            browser,
            "document.querySelector('#view').dataset.tried",
            f"{slider}.value = {200 + turn % 9}; {slider}.dispatchEvent(new Event('input'))",
        )
        for turn in range(turns)
    ]
    print(f"slider to curve, median of {turns}  {median(tries):8.1f} ms (longest {max(tries):.0f} ms)")


def cancel_of(serving: Serving) -> None:
    """From the cancel of a fit at work until none of its processes is left."""
    job = serving.page.start_job({"command": "fit", "scene": "pair.toml", "out": "cancelled"})
    time.sleep(STARTED)
    began = time.perf_counter()
    ended = serving.page.cancel_job({"id": job["id"]})
    print(f"cancel to idle  {time.perf_counter() - began:8.2f} s (the fit is {ended['state']})")


def main(fast: bool = False, samples: int = 10_000_000) -> None:
    """Print the table; fast: of 100,000 samples, five turns."""
    if CHROMIUM is None:
        print("no Chromium is installed (Debian: apt-get install chromium): nothing was measured")
        return
    with tempfile.TemporaryDirectory() as place:
        root = Path(place)
        long_log(root / "long.h5", 100_000 if fast else samples)
        serving = Serving(Folder.at(root))
        serving.page.put_examples({})
        serving.start()
        turns = 5 if fast else TURNS
        try:
            with PageBrowser() as browser:
                browser.size(1280, 900)
                curves_of(browser, serving, "long.h5", turns)
                sliders_of(browser, serving, turns)
            cancel_of(serving)
        finally:
            serving.stop()


if __name__ == "__main__":
    main(samples=int(sys.argv[1]) if len(sys.argv) > 1 else 10_000_000)
