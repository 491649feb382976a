"""A served folder with the example pair, and a browser on it where there is one."""

import json
import shutil
import tomllib
import urllib.error
import urllib.request
from contextlib import contextmanager

import numpy as np
import pytest

pytest.importorskip("starlette", reason="the extra `app` is not installed")

from data_io import Record, read_log, write_csv
from identify.app.folder import Folder
from identify.app.looks import Looks
from identify.app.server import Serving
from identify.base.document import to_dict
from identify.cli.logs import document, inspection
from identify.scene import Scene
from identify.simulation.simulate import simulate
from tests.support.browser import CHROMIUM, Browser


class Client:
    """Asks a server as a page does; `host`, `origin` and `token` may be those of somebody else."""

    def __init__(self, serving):
        self.serving = serving

    def ask(self, path, body=None, *, method=None, host=None, origin=None, token=None):
        """Status, headers and body."""
        address = f"http://127.0.0.1:{self.serving.port}/{self.serving.token if token is None else token}/{path}"
        request = urllib.request.Request(address, data=body, method=method)
        for name, value in (("Host", host), ("Origin", origin)):
            if value is not None:
                request.add_header(name, value)
        try:
            with urllib.request.urlopen(request) as response:
                return response.status, dict(response.headers), response.read()
        except urllib.error.HTTPError as error:
            return error.code, dict(error.headers), error.read()

    def post(self, name, **asked):
        status, _, body = self.ask(f"api/{name}", json.dumps(asked).encode())
        return status, json.loads(body)

    def get(self, name, **asked):
        status, _, body = self.ask(f"api/{name}?{urllib.parse.urlencode(asked)}")
        return status, json.loads(body)


RIG = """
[rig]
mass = "0.2 kg" # weighed
stiffness = "1470 N/m"
damping = "147 N/m" # h of eq. 1
"""
HELD = """
[parameters]
delta_mu_k = { fixed = -0.13 }
a = { fixed = 300.0 }
D = { fixed = "37.4 um" }
t_cr = { fixed = "0.5 s" }
"""
SIMULATED = f'normal_force = "1 N"\n{HELD}mu_s = {{ fixed = 0.5 }}\nmu_k0 = {{ fixed = 0.4 }}\n'
MADE_OF = 'effects = ["inertia", "hysteresis_damping", "contact_ageing", "velocity_weakening"]\n'
LOGS = {"1_mm_per_s.csv": ("1 mm/s", 1.8, 1000.0), "5_mm_per_s.csv": ("5 mm/s", 0.8, 2000.0)}  # seconds, hertz
NOISE = 0.005  # N


def write_log(path, speed, duration, rate):
    """A simulated log of the pair under 1 N, which tells its drive speed."""
    scene = Scene.from_document(tomllib.loads(MADE_OF + RIG + f'drive_speed = "{speed}"\n' + SIMULATED))
    times = np.arange(int(duration * rate) + 1) / rate
    force = simulate(scene, duration).sample(times)["force"] + np.random.default_rng(1).normal(0.0, NOISE, times.size)
    write_csv(Record(times, np.ones_like(times), force, drive_speed=scene.rig.drive_speed), path)


@pytest.fixture(scope="session")
def looked_at(tmp_path_factory):
    """Two short logs, a scene of them with two parameters to find, and what the page has seen in them."""
    place = tmp_path_factory.mktemp("looked_at")
    for name, (speed, duration, rate) in LOGS.items():
        write_log(place / name, speed, duration, rate)
    listed = "".join(f'\n[[logs]]\npath = "{name}"\n' for name in LOGS)
    (place / "pair.toml").write_text(MADE_OF + RIG + HELD + listed)
    looks = Looks(Folder.at(place))
    for name in LOGS:  # as processes of the page do, without their start
        looks.keep(name, to_dict(document(inspection(f"./{name}", read_log(place / name)))))
    looks.close()
    return place


@contextmanager
def served(root):
    """A server of a folder, with whose end its jobs end."""
    made = Serving(Folder.at(root))
    made.start()
    yield made
    for job in made.page.jobs.listed():
        made.page.jobs.cancel(job["id"])
    made.stop()


@pytest.fixture
def root(tmp_path, looked_at):
    """A folder of its own with these logs and their scene; they are as old, so that nothing is looked at again."""
    return shutil.copytree(looked_at, tmp_path / "logs of the lab")


@pytest.fixture
def serving(root):
    with served(root) as made:
        yield made


@pytest.fixture
def client(serving):
    return Client(serving)


@pytest.fixture(scope="session")
def unchanged(tmp_path_factory, looked_at):
    """A client of one server for all tests that leave its folder as it is."""
    with served(shutil.copytree(looked_at, tmp_path_factory.mktemp("unchanged") / "logs of the lab")) as made:
        yield Client(made)


@pytest.fixture(scope="session")
def chromium():
    if CHROMIUM is None:
        pytest.skip("no Chromium is installed (Debian: apt-get install chromium)")
    with Browser() as made:
        yield made


@pytest.fixture
def page(chromium, serving):
    """The browser on the first view; afterwards nothing but this server may have been asked, and nothing complained."""
    chromium.errors.clear()
    chromium.requests.clear()
    chromium.size(1280)
    chromium.visit(serving.address)
    yield chromium
    chromium.call("Page.navigate", url="about:blank")
    elsewhere = [url for url in chromium.requests if url.startswith("http") and f"127.0.0.1:{serving.port}/" not in url]
    assert elsewhere == [] and chromium.errors == []
