"""How fast the page is: first picture, pan and zoom of ten million samples, and the try sliders, in headless Chromium.

The server runs on one core and the browser on the others. Prints a table, with the machine and what else it was at work
on; --docs also makes docs/app.png. Needs the extra `app`, Chromium and Linux.

    python experiments/run_app_speed.py [samples] [--docs]
"""

import json
import os
import subprocess
import sys
import tempfile
import time
import urllib.request
from collections.abc import Iterable
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from data_io import Record, write_hdf5
from experiments.machine import describe
from identify.app.jobs import same_code
from tests.app.browser import PageBrowser
from tests.support.browser import CHROMIUM

TURNS = 50
RATE = 2000.0  # [Hz]
STARTED = 4.0  # seconds after which a fit is at work


class PinnedServer:
    """`stickslip app` of a folder as a process of its own on the first core; what asks it, the browser too, is on the
    others where there are any."""

    def __init__(self, root: Path) -> None:
        cores = sorted(os.sched_getaffinity(0))
        os.sched_setaffinity(0, set(cores[:1]))
        words = [sys.executable, "-P", "-m", "identify", "app", str(root), "--no-browser"]
        environment = same_code() | {"PYTHONUNBUFFERED": "1"}
        self.process = subprocess.Popen(words, stdout=subprocess.PIPE, text=True, env=environment)
        os.sched_setaffinity(0, set(cores[1:] or cores))
        assert self.process.stdout is not None
        self.address = self.process.stdout.readline().strip()

    def ask(self, name: str, body: dict[str, Any] | None = None) -> dict[str, Any]:
        """An answer of the server; body: what is posted."""
        data = None if body is None else json.dumps(body).encode()
        with urllib.request.urlopen(f"{self.address}api/{name}", data) as response:
            return dict(json.loads(response.read()))

    @property
    def peak(self) -> float:
        """The most memory it has taken [MB]."""
        return memory(self.process.pid, "VmHWM")

    def stop(self) -> None:
        """End it."""
        self.process.terminate()
        self.process.wait(10)


def memory(process: int, what: str = "VmRSS") -> float:
    """Resident memory of a process [MB], now or at most."""
    lines = Path(f"/proc/{process}/status").read_text().splitlines()
    return next(float(line.split()[1]) / 1024 for line in lines if line.startswith(what))


def renderers(browser: PageBrowser) -> list[int]:
    """The processes that draw the pages of a browser."""
    found = []
    for place in Path("/proc").glob("[0-9]*"):
        try:
            words = (place / "cmdline").read_bytes()
        except OSError:
            continue
        if browser._profile.name.encode() in words and b"--type=renderer" in words:
            found.append(int(place.name))
    return found


def spent(processes: Iterable[int]) -> float:
    """Processor seconds that processes have used."""
    fields = [Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split() for process in processes]
    return sum(int(f[11]) + int(f[12]) for f in fields) / float(os.sysconf("SC_CLK_TCK"))


def waits(browser: PageBrowser, serving: PinnedServer, counter: str, acts: Iterable[str]) -> str:
    """How long acts take until what they show is drawn, in words: the median, and their processor time, which other
    work on the machine does not lengthen."""
    groups = {"server": [serving.process.pid], "page": renderers(browser)}
    before = {name: spent(processes) for name, processes in groups.items()}
    taken = [waited(browser, counter, act) for act in acts]
    own = {name: 1e3 * (spent(processes) - before[name]) / len(taken) for name, processes in groups.items()}
    processor = ", ".join(f"{name} {each:.0f}" for name, each in own.items())
    return f"{median(taken):6.1f} ms, longest {max(taken):.0f}; processor each: {processor} ms"


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


def curves_of(browser: PageBrowser, serving: PinnedServer, name: str, turns: int) -> None:
    """First picture, pan and zoom of one log."""
    began = time.perf_counter()
    while not (about := serving.ask(f"log?path={name}"))["ready"]:
        time.sleep(0.01)
    print(f"reading {about['rows']:,} samples  {time.perf_counter() - began:8.2f} s")
    began = time.perf_counter()
    browser.visit(f"{serving.address}#log?path={name}&alone=1")
    browser.wait("Number(document.querySelector('#plots').dataset.drawn) > 0")
    print(f"first picture after reading  {time.perf_counter() - began:8.2f} s (the page opened anew)")
    drawn, view = "document.querySelector('#plots').dataset.drawn", "document.querySelector('#view').timeView"
    browser.wait(f"{view}")
    shares = [0.9 ** (turn % 25) for turn in range(turns)]
    zooms = (f"{view}.go({view}.begin, {view}.begin + {view}.whole[1] * {share})" for share in shares)
    print(f"zoom, median of {turns}  {waits(browser, serving, drawn, zooms)}")
    step = f"0.1 * ({view}.end - {view}.begin)"
    pans = [f"{view}.go({view}.begin + {step}, {view}.end + {step})"] * turns
    print(f"pan, median of {turns}  {waits(browser, serving, drawn, pans)}")
    points = browser.ask(f"{view}.rows[0].length")
    heap, page = browser.call("Runtime.getHeapUsage")["usedSize"], sum(map(memory, renderers(browser)))
    print(f"points a curve {points};  page {heap / 1e6:.0f} MB of JavaScript, its processes {page:.0f} MB")
    print(f"server {memory(serving.process.pid):.0f} MB, at most {serving.peak:.0f} MB")


def sliders_of(browser: PageBrowser, serving: PinnedServer, turns: int) -> None:
    """From a slider to the curve, for the demo's log at 1 mm/s."""
    browser.visit(f"{serving.address}#try?scene=pair.toml&number=2")
    browser.wait("document.querySelector('#view').dataset.tried")
    slider = "document.querySelector('[data-parameter=mu_s]')"
    tries = (f"{slider}.value = {200 + turn % 9}; {slider}.dispatchEvent(new Event('input'))" for turn in range(turns))
    counter = "document.querySelector('#view').dataset.tried"
    print(f"slider to curve, median of {turns}  {waits(browser, serving, counter, tries)}")


def picture_of(browser: PageBrowser, serving: PinnedServer) -> None:
    """The log of the demo at 1 mm/s with its slips, as docs/app.png."""
    browser.visit(f"{serving.address}#log?scene=pair.toml&number=2")
    browser.wait(
        "document.querySelector('#view').dataset.seen === 'yes' && document.querySelector('#plots').dataset.drawn"
    )
    browser.ask("document.getElementById('folder').textContent = 'my-logs'")
    browser.picture(Path(__file__).parents[1] / "docs" / "app.png", whole=False)


def cancel_of(serving: PinnedServer, started: float = STARTED) -> None:
    """From the cancel of a fit at work until none of its processes is left."""
    job = serving.ask("start", {"command": "fit", "scene": "pair.toml", "out": "cancelled"})
    time.sleep(started)
    began = time.perf_counter()
    ended = serving.ask("cancel", {"id": job["id"]})
    print(f"cancel to idle  {time.perf_counter() - began:8.2f} s (the fit is {ended['state']})")


def main(fast: bool = False, samples: int = 10_000_000, docs: bool = False) -> None:
    """Print the table; fast: of 100,000 samples, two turns. docs: make the picture of the page too."""
    if CHROMIUM is None:
        print("no Chromium is installed (Debian: apt-get install chromium): nothing was measured")
        return
    print(describe())
    with tempfile.TemporaryDirectory() as place:
        root = Path(place)
        long_log(root / "long.h5", 100_000 if fast else samples)
        serving = PinnedServer(root)
        serving.ask("examples", {})
        turns = 2 if fast else TURNS
        try:
            with PageBrowser() as browser:
                browser.size(1280, 900)
                curves_of(browser, serving, "long.h5", turns)
                sliders_of(browser, serving, turns)
                if docs:
                    browser.size(1280, 860)
                    picture_of(browser, serving)
            cancel_of(serving, 1.0 if fast else STARTED)
        finally:
            serving.stop()


if __name__ == "__main__":
    counts = [int(word) for word in sys.argv[1:] if word.isdigit()]
    main(samples=counts[0] if counts else 10_000_000, docs="--docs" in sys.argv)
