"""A served folder with the example pair, and a browser on it where there is one."""

import json
import shutil
import urllib.error
import urllib.request

import pytest

pytest.importorskip("starlette", reason="the extra `app` is not installed")

from identify import examples
from identify.app.folder import Folder
from identify.app.server import Serving
from tests.app.browser import PageBrowser
from tests.support.browser import CHROMIUM


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


@pytest.fixture
def root(tmp_path):
    """A folder with the example logs and their scene, two of them named like trouble."""
    place = tmp_path / "logs of the lab"
    place.mkdir()
    for item in examples.FOLDER.iterdir():
        if item.name.endswith((".txt.gz", "pair.toml")):
            shutil.copyfile(item, place / item.name)
    return place


@pytest.fixture
def serving(root):
    made = Serving(Folder.at(root))
    made.start()
    yield made
    for job in made.page.jobs.listed():
        made.page.jobs.cancel(job["id"])
    made.stop()


@pytest.fixture
def client(serving):
    return Client(serving)


@pytest.fixture(scope="session")
def chromium():
    if CHROMIUM is None:
        pytest.skip("no Chromium is installed (Debian: apt-get install chromium)")
    with PageBrowser() as made:
        yield made


@pytest.fixture
def page(chromium, serving):
    """The browser on the first view; afterwards nothing but this server may have been asked, and nothing complained."""
    chromium.errors.clear()
    chromium.requests.clear()
    chromium.size(1280, 900)
    chromium.visit(serving.address)
    yield chromium
    chromium.call("Page.navigate", url="about:blank")
    elsewhere = [url for url in chromium.requests if url.startswith("http") and f"127.0.0.1:{serving.port}/" not in url]
    assert elsewhere == [] and chromium.errors == []
