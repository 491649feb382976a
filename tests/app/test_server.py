"""The server without a browser: who is refused, which paths, names of logs, jobs that are cancelled and killed."""

import os
import random
import shlex
import signal
import subprocess
import sys
import time
import tomllib
from pathlib import Path

import numpy as np
import pytest

from data_io import Record
from identify.app.curves import MOST_POINTS, OpenLog
from identify.app.folder import Folder, PageError
from identify.app.jobs import same_code, words_of
from identify.app.scenes import edited
from identify.cli import main as cli
from tests.app.conftest import Client, served

NASTY = "<img src=x onerror=alert(1)><script>alert(2)<!--.txt"


FOREIGN = [("host", "evil.example"), ("host", "127.0.0.1"), ("origin", "http://evil.example"), ("origin", "null"),
           ("token", "guessed"), ("token", "")]  # fmt: skip


@pytest.mark.parametrize("path", ["", "api/folder", "files/pair.toml"])
def test_who_is_not_the_page_is_refused(unchanged, path):
    for name, value in FOREIGN:
        status, _, body = unchanged.ask(path, **{name: value})
        assert status == 403 and b"Refused" in body and b"pair" not in body
    own = f"http://127.0.0.1:{unchanged.serving.port}"
    assert unchanged.ask(path, origin=own)[0] == 200, "the page itself is let in"


OUTSIDE = ["sub/../../secret.txt", "/etc/passwd", "..\\secret.txt", ".stickslip-app/jobs", "link.txt", ""]


@pytest.mark.parametrize("path", OUTSIDE)
def test_no_path_leads_out_of_the_folder(unchanged, path):
    client, root = unchanged, unchanged.serving.page.folder.root
    (root.parent / "secret.txt").write_text("time,force\n0,1\n1,2\n")
    (root / "link.txt").unlink(missing_ok=True)
    (root / "link.txt").symlink_to(root.parent / "secret.txt")
    questions = [
        client.get(name, path=path) for name in ("log", "curves", "scene", "fit", "batch", "groups", "residuals")
    ]
    for name, asked in {
        "save": {"path": path},
        "edit": {"path": "pair.toml", "logs": [path]},
        "manifest": {"path": "m.csv", "rows": [{"path": path}]},
        "point": {"fit": path},
        "start": {"command": "fit", "scene": path or "../x", "out": "x"},
    }.items():
        questions.append(client.post(name, **asked))
    questions += [
        client.post("edit", path=path, text="a = 1"),
        client.post("manifest", path=path, rows=[{"path": "pair.toml"}]),
        client.post("start", command="fit", scene="pair.toml", out=path or "../x"),
        client.post("start", command="scene", logs=[path], out="x.toml"),
    ]
    assert [status for status, _ in questions] == [400] * len(questions)
    assert all("Traceback" not in str(answer) and "defect" not in str(answer) for _, answer in questions)
    assert client.ask(f"files/{path}" if path else "files/%2e%2e/secret.txt")[0] == 404
    assert client.ask(f"api/add?name={path or '../x'}", b"1 2\n", method="POST")[0] == 400
    assert not (root.parent / "x").exists() and not list(root.parent.glob("*.toml"))


def test_a_log_may_be_called_anything(client, root):
    (root / NASTY).write_text(
        "time,normal force,friction force\ns,N,N\n" + "".join(f"{i},1,{i % 7}\n" for i in range(99))
    )
    deadline = time.monotonic() + 90
    while True:
        status, found = client.get("folder")
        row = next(log for log in found["logs"] if log["path"] == NASTY)
        if row["ready"] or time.monotonic() > deadline:
            break
        time.sleep(0.2)
    assert status == 200 and row["ready"] and row["verdict"] in ("accept", "accept with warnings", "reject")
    report = root / "report.html"
    report.write_text("<script>parent.document.title = 'stolen'</script>")
    _, headers, _ = client.ask("files/report.html")
    assert (
        "sandbox" in headers["content-security-policy"] and "default-src 'none'" in headers["content-security-policy"]
    )


def test_only_commands_of_the_page_are_run(tmp_path):
    (tmp_path / "pair.toml").write_text("")
    (tmp_path / "next.steps.csv").write_text("log,step\n")
    folder = Folder.at(tmp_path)
    words, out = words_of(folder, {"command": "fit", "scene": "pair.toml", "out": "--evil", "time-limit": "5 s"})
    assert out == "--evil" and words == ["fit", "--scene", "pair.toml", "--out", "./--evil", "--time-limit=5 s"]
    plan = {"command": "plan", "source": "pair.toml", "out": "next.steps.csv", "set": ["rig.drive_speed=1 mm/s"]}
    words, out = words_of(folder, plan)
    assert (
        words == ["plan", "pair.toml", "--out", "next.steps.csv", "--set=rig.drive_speed=1 mm/s"]
        and out == "next.steps.csv"
    )
    for asked in (
        {"command": "cache"},
        {"command": "fit", "debug": True},
        {"command": "fit", "scene": "/etc/passwd"},
        {"command": "stability", "map": ["x; rm"]},
        {"command": "fit", "accuracy": "a\nb"},
    ):
        with pytest.raises(PageError):
            words_of(folder, asked)


def test_a_curve_of_any_length_keeps_its_extremes():
    rng, n = np.random.default_rng(3), 70_001
    force, load = rng.normal(size=(2, n))
    force[[5, 35_000, n - 1]], load[7] = (50.0, -60.0, np.nan), 9.0
    opened = OpenLog(record=Record(np.arange(float(n)), load, force))
    for begin, end in ((-np.inf, np.inf), (30_000, 42_000), (34_990, 35_010), (1, 66)):
        time, *drawn, speed = opened.window(begin, end)
        rows = slice(max(int(max(begin, 0)) - 1, 0), min(int(min(end, n - 1)) + 2, n))
        assert time.size <= MOST_POINTS and np.all(np.diff(time) > 0) and np.isnan(speed).all()
        for shown, whole in zip(drawn, (force[rows], load[rows]), strict=True):
            assert (np.nanmin(shown), np.nanmax(shown)) == (np.nanmin(whole), np.nanmax(whole))


def test_a_field_is_written_and_the_rest_of_the_text_stays():
    text = '# mine\neffects = ["inertia"]  # all\n[rig]\nmass = "0.2 kg" # weighed\n[[logs]]\npath = "a.txt"\n'
    made = edited(text, ["rig", "mass"], "180 g")
    assert made == text.replace('"0.2 kg"', '"180 g"')
    assert edited(made, ["rig", "mass"], "0.2 kg") == text
    assert 'window = ["1 s", "2 s"]' in edited(text, ["logs", "1", "window"], ["1 s", "2 s"])
    assert "mu_s = {start = 0.6}" in edited(text, ["parameters", "mu_s", "start"], "0.6")
    later = text.replace("[rig]", "[fit]\ntime_limit = 9\n[rig]")  # a value would end up in the table before
    filed = edited(later, ["rig"], "rig.toml")
    assert tomllib.loads(filed)["rig"] == "rig.toml" and tomllib.loads(filed)["fit"] == {"time_limit": 9}
    assert "rig" not in tomllib.loads(edited(filed, ["rig"], None))
    for keys in (["logs", "2", "path"], ["rig", "mass", "x"], ["a b"], []):
        with pytest.raises(PageError):
            edited(text, keys, "1")


def wait_for(client, job, *states, patience=120.0):
    deadline = time.monotonic() + patience
    while time.monotonic() < deadline:
        found = next(one for one in client.get("folder")[1]["jobs"] if one["id"] == job)
        if found["state"] != "running":
            break
        time.sleep(0.1)
    assert found["state"] in states, found
    return found


def seconds_of_processor(session):
    """Processor seconds that the processes of a session have used so far; None where none is left."""
    used = []
    for place in Path("/proc").iterdir():
        try:
            if place.name.isdigit() and os.getsid(int(place.name)) == session:
                fields = (place / "stat").read_text().rpartition(")")[2].split()
                if fields[0] != "Z":
                    used.append((int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK"))
        except OSError:
            continue
    return sum(used) if used else None


def test_a_cancelled_fit_is_idle_within_two_seconds(client, serving, root):
    status, job = client.post("start", command="fit", scene="pair.toml", out="one")
    assert status == 200 and job["command"] == "stickslip fit --scene pair.toml --out one"
    assert client.post("start", command="fit", scene="pair.toml", out="one")[0] == 400, "one writer at a time"
    while not client.get("folder")[1]["jobs"][0]["stages"]:
        time.sleep(0.05)
    session = serving.page.jobs._children[job["id"]].pid
    assert seconds_of_processor(session), "it was at work"
    began = time.monotonic()
    _, ended = client.post("cancel", id=job["id"])
    assert ended["state"] == "cancelled" and seconds_of_processor(session) is None
    assert time.monotonic() - began < 2.0 and not (root / "one").exists()
    assert [item.name for item in root.iterdir() if item.name.startswith(".one")] == []


def test_fits_killed_at_random_instants_leave_nothing_half_written(client, serving, root):
    rng = random.Random(51)
    (root / ".one.1.part").mkdir()  # of another process that is at work
    for _ in range(3):
        _, job = client.post("start", command="fit", scene="pair.toml", out="one")
        time.sleep(rng.uniform(0.0, 1.5))
        child = serving.page.jobs._children[job["id"]]
        os.killpg(child.pid, signal.SIGKILL)
        child.wait(5)
        found = wait_for(client, job["id"], "killed", "done")
        assert found["state"] == "done" or "start it again" in found["message"]
        assert [item.name for item in root.iterdir() if item.name.startswith(".one")] == [".one.1.part"]
        for result in root.glob("one/result.json"):
            assert client.get("fit", path="one")[0] == 200, result


def test_a_server_that_starts_again_finds_what_ran(client, root):
    _, job = client.post("start", command="scene", logs=["5_mm_per_s.csv"], out="new.toml")
    with served(root) as other:
        found = wait_for(Client(other), job["id"], "done")
        assert (root / "new.toml").exists() and shlex.split(found["command"])[:2] == ["stickslip", "scene"]


def test_without_the_extra_one_sentence_says_what_to_install(monkeypatch, capsys):
    monkeypatch.setattr("identify.cli.app.find_spec", lambda name: None)
    assert cli.main(["app"]) == 2
    said = capsys.readouterr().err
    assert "pip install" in said and "[app]" in said and len(said.splitlines()) == 1
    code = "import sys; import identify.cli.main as m; m.build_parser(); print('starlette' in sys.modules)"
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=same_code())
    assert told.stdout.strip() == "False", "the other commands do not pay for it"


def test_the_command_serves_until_it_is_interrupted(root):
    process = subprocess.Popen(
        [sys.executable, "-P", "-m", "identify", "app", str(root), "--no-browser"],
        stdout=subprocess.PIPE,
        text=True,
        env=same_code() | {"PYTHONUNBUFFERED": "1"},
    )
    assert process.stdout is not None
    address = process.stdout.readline().strip()
    assert address.startswith("http://127.0.0.1:")
    process.send_signal(signal.SIGINT)
    assert process.wait(15) == 130
