"""What nobody should ask of the page, and files that nobody should give it: one sentence, nothing lost."""

import json
import os
import socket
import threading
import urllib.parse
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from identify.app.folder import Folder
from identify.app.server import Serving
from identify.cli import main as cli
from tests.app.conftest import Client, served


@pytest.fixture
def empty(tmp_path):
    with served(tmp_path) as made:
        yield made


def test_of_eight_uploads_of_one_name_one_is_kept(empty):
    client, gate = Client(empty), threading.Barrier(8)

    def add(number):
        gate.wait()
        return client.ask("api/add?name=log.csv", 1000 * str(number).encode())

    with ThreadPoolExecutor(8) as pool:
        answers = list(pool.map(add, range(8)))
    added = [number for number, (status, _, _) in enumerate(answers) if status == 200]
    assert len(added) == 1
    assert (empty.page.folder.root / "log.csv").read_bytes() == 1000 * str(added[0]).encode()
    assert all(b"is there already" in body for status, _, body in answers if status != 200)
    assert [path.name for path in empty.page.folder.root.rglob("added-*/*")] == []


@pytest.mark.parametrize(
    "text", ["{}", "not JSON", 20_000 * "[", '{"parameters": [1], "provenance": 3, "status": null}']
)
def test_a_file_called_as_a_result_hides_no_log(empty, text):
    root, client = empty.page.folder.root, Client(empty)
    (root / "log.csv").write_text("time,force\n", encoding="utf-8")
    for name in ("result.json", "comparison.json", "batch.json"):
        assert client.ask(f"api/add?name={name}", text.encode())[0] == 200
    status, listed = client.get("folder")
    assert status == 200 and [row["path"] for row in listed["logs"]] == ["log.csv"]
    assert client.get("fit", path=".")[0] == 400 or text == "{}"


def test_links_that_lead_to_each_other_and_names_that_are_no_text_hide_nothing(empty):
    root, client = empty.page.folder.root, Client(empty)
    (root / "log.csv").write_text("time,force\n", encoding="utf-8")
    (root / "one").symlink_to("two")
    (root / "two").symlink_to("one")
    (root / "sub").mkdir()
    (root / "sub" / "up").symlink_to(root)
    (root / "sub" / "captions.txt").write_text("of figures, as `stickslip figures` writes them", encoding="utf-8")
    Path(os.fsdecode(os.fsencode(root) + b"/no_text_\xff.csv")).touch()
    status, listed = client.get("folder")
    assert status == 200 and [row["path"] for row in listed["logs"]] == ["log.csv"]
    assert client.ask("files/one")[0] == 404


LONG = 300 * "a"


def test_every_refusal_is_a_sentence(unchanged):
    """Names that are too long, deep JSON and values of the wrong kind, at every question the page has."""
    names = [f"{LONG}/x.csv", "a/" * 400, "\ud800", 255 * "ä", "..", ".", "pair.toml/x", ""]
    questions = list(unchanged.serving.page.answers)
    answers = []
    for name in names:
        text = urllib.parse.quote(name, errors="surrogatepass")
        answers.append(unchanged.ask(f"files/{text}"))
        answers.append(unchanged.ask(f"api/add?name={text}", b"x"))
        for question in questions:
            answers.append(unchanged.ask(f"api/{question}?path={text}&scene={text}&id={text}&number=1e400"))
            asked = dict.fromkeys(("path", "scene", "id", "fit", "command", "text", "out"), name)
            answers.append(unchanged.ask(f"api/{question}", json.dumps(asked).encode()))
    for question in questions:
        wrong = b'{"path": 3, "scene": ["x"], "number": {}, "values": 3, "changes": [1]}'
        for body in (20_000 * b"[", b'{"a":' * 20_000, b"[1, 2]", b"\xff\xfe", wrong):
            answers.append(unchanged.ask(f"api/{question}", body))
    for status, _, body in answers:
        if status >= 400 and status != 405:
            sentence = json.loads(body)["error"]
            assert sentence and "Traceback" not in sentence and "defect" not in sentence, sentence
    assert {status for status, *_ in answers} <= {200, 400, 404, 405, 413}


def test_half_an_upload_goes_with_the_server(tmp_path):
    serving = Serving(Folder.at(tmp_path))
    serving.start()
    client = Client(serving)
    assert client.get("folder")[0] == 200
    with socket.create_connection(("127.0.0.1", serving.port)) as upload:
        head = f"POST /{serving.token}/api/add?name=a.csv HTTP/1.1\r\nHost: localhost:{serving.port}\r\n"
        upload.sendall(f"{head}Content-Length: 1000000\r\n\r\n{500 * 'x'}".encode())
        while not list(tmp_path.rglob("added-*/*")):
            pass
        serving.stop()
    assert not (tmp_path / "a.csv").exists() and not list(tmp_path.rglob("added-*"))


def test_the_key_is_no_argument_of_a_program(tmp_path, monkeypatch):
    """Every user of the machine can read those: the browser is given a file that only its owner can read."""
    opened = []

    def remember(address):
        path = Path(address.removeprefix("file://"))
        opened.extend((address, path, path.read_text(encoding="utf-8"), path.stat().st_mode & 0o077))
        raise KeyboardInterrupt

    monkeypatch.setattr("webbrowser.open", remember)
    assert cli.main(["app", str(tmp_path)]) == 130
    address, path, page, others = opened
    token = page.partition("url=http://127.0.0.1:")[2].split("/")[1]
    assert len(token) > 20 and token not in address and others == 0 and not path.exists()


def test_the_page_is_reached_through_another_port_of_this_machine(unchanged):
    """A tunnel (ssh -L): the address names the port it is reached by, and other origins stay refused."""
    for host in ("localhost:9999", "127.0.0.1:9999"):
        assert unchanged.ask("api/folder", host=host, origin=f"http://{host}")[0] == 200
        assert unchanged.ask("api/folder", host=host, origin="http://localhost:1234")[0] == 403
        assert unchanged.ask("api/folder", host=host, token="guessed")[0] == 403
    for host in ("localhost.evil.example:80", "127.0.0.1:9999.evil.example", "evil.example:9999"):
        assert unchanged.ask("api/folder", host=host)[0] == 403
