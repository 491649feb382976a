"""`inspect`, `scene`, `convert` and `simulate`: the verdict a person agrees with, drafts, and logs that read back."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from data_io import Record, read_log, write_csv, write_hdf5
from identify import examples
from identify.effects import MAIN
from identify.scene import Scene
from tests.support.command import RIG, refused, simulated, stickslip

LOGS = [examples.FOLDER / name for name in ("1_mm_per_s.txt.gz", "5_mm_per_s.txt.gz")]
MEASURED = Path(__file__).resolve().parents[3] / "shared" / "data" / "paper_on_paper"


HEAD = """Created by CETR Data Viewer ver.2.19.106 05/12/22 14:43:46
C:\\Users\\meier\\secret project\\skin.tst

Run # 1
Script file C:\\Users\\meier\\skin on paper.cts
Run date 12 May 2022 12:21:50
Operator = Anna Meier
Note: volunteer V07 was nervous
Step No. 1

Set Force    = -200
Velocity     = 2
Sample of Anna = 3
Duration     = 2.17
Started at: 12:21:58.029 12 May 2022

T,Fx,Fz,COF,Annas Kanal
sec,g,g,,mm
"""


# what somebody who looks at the plot says of each record, beside its spikes
SEEN = {
    "k168_v42": {"spikes", "friction_drift"},
    "k1002_v4300": {"spikes", "stick_slope"},
}


@pytest.mark.parametrize("name", SEEN)
def test_the_verdict_on_measured_records_is_that_of_a_person(name, capsys):
    path = MEASURED / f"{name}.csv"
    if not path.is_file():
        pytest.skip("the measured paper-on-paper records are not on this machine")
    stiffness, speed = (word[1:] for word in name.split("_"))
    arguments = ["inspect", str(path), "--stiffness", f"{stiffness} N/m", "--drive-speed", f"{speed} um/s", "--json"]
    code, out, _ = stickslip(capsys, *arguments)
    quality = json.loads(out)["logs"][0]["quality"]
    assert code == 0
    assert quality["verdict"] == "accept with warnings"
    assert {f["code"] for f in quality["findings"] if f["severity"] != "info"} == SEEN[name]


def test_inspect_tells_what_is_in_the_logs(folder, capsys):
    slow, stepped = examples.FOLDER / "0.1_mm_per_s.txt.gz", examples.FOLDER / "1_mm_per_s.txt.gz"
    code, words, _ = stickslip(capsys, "inspect", slow, stepped)
    assert code == 0 and "5 stick-slip cycles" in words and "column Fx in g" in words
    code, out, _ = stickslip(capsys, "inspect", slow, stepped, "--json")
    one, two = json.loads(out)["logs"]
    assert one["rows"] == 10001 and [step["cycles"] for step in two["steps"]] == [0, 13]
    assert one["steps"][0]["noise_N"] == pytest.approx(5e-3, rel=0.05)
    assert two["steps"][1]["stick_slope_N_per_s"][0] == pytest.approx(1470 * 1e-3, rel=0.02)
    assert max(len(line) for line in words.splitlines() if "/" not in line) <= 80


def test_several_logs_end_in_a_table_of_all_and_a_picture(folder, capsys):
    logs = [LOGS[0], examples.FOLDER / "0.1_mm_per_s_at_50_Hz.txt.gz"]
    Path("bad $log$ µ.csv").write_text("T,Fx,Fz\ns,N,N\n0,1,1\n1,1,1\n0.5,1,1\n")
    code, out, _ = stickslip(capsys, "inspect", *logs, "bad $log$ µ.csv", "--plot", "all.svg")
    assert code == 2 and all(Path(f"all_{number}.svg").stat().st_size > 5000 for number in (1, 2))
    head, stepped, coarse, bad = out.splitlines()[-5:-1]
    assert head.split()[0] == "log" and max(map(len, (head, stepped, coarse, bad))) <= 80
    assert stepped.split() == ["1_mm_per_s.txt.gz", "1000", "Hz", "several", "stick", "slip", "13", "accept"]
    assert coarse.split()[:3] == ["0.1_mm_per_s_at_50_Hz.t…", "50", "Hz"] and coarse.endswith("warnings")
    assert bad.endswith("reject")
    code, out, _ = stickslip(capsys, "inspect", "bad $log$ µ.csv", LOGS[0], "--json")
    document = json.loads(out)
    assert code == 2 and "1 of 2 logs cannot be read" in document["message"]
    assert [log["quality"]["verdict"] for log in document["logs"]] == ["reject", "accept"]
    assert "falls from" in document["logs"][0]["quality"]["findings"][0]["message"]


def test_a_first_scene_is_drafted_from_the_logs(folder, capsys):
    logs = sorted(examples.FOLDER.glob("*.txt.gz"))
    code, words, _ = stickslip(capsys, "scene", *logs, "--out", "pair.toml")
    assert code == 0 and "rig.mass, rig.zeta" in words
    sentence = refused(capsys, "fit", "--scene", "pair.toml")
    assert "still to fill in: rig.mass, rig.zeta" in sentence
    text = Path("pair.toml").read_text().replace("TODO kg", "0.2 kg").replace('zeta = "TODO"', 'damping = "147 N/m"')
    Path("pair.toml").write_text(text)
    scene = Scene.from_toml("pair.toml")
    assert scene.effects == (*MAIN[:4], "varying_normal_force")
    assert scene.rig.stiffness == pytest.approx(1470, rel=0.01), "force per drive distance while it sticks"
    truth = json.loads(examples.TRUTH.read_text())["logs"]
    for entry in scene.logs:
        assert entry.drive_speed == pytest.approx(truth[entry.path.name]["drive_speed"], rel=1e-3)
        assert entry.path.resolve() == examples.FOLDER / entry.path.name
    steps = {entry.path.name: entry.step for entry in scene.logs if entry.step is not None}
    assert steps == {"1_mm_per_s.txt.gz": 2}, "the hold before the test is left out"


def test_a_first_scene_takes_a_rig_that_was_measured(folder, capsys):
    log = examples.FOLDER / "1_mm_per_s.txt.gz"
    Path("bench").mkdir()
    Path("bench/rig.toml").write_text('mass = "0.2 kg"\nstiffness = "1470 N/m"\nzeta = 0.05\n')
    asked = ("scene", log, "--rig", "bench/rig.toml", "--out", "scenes.toml")
    code, words, _ = stickslip(capsys, *asked)
    assert code == 0 and "still to fill in" not in words
    scene = Scene.from_toml("scenes.toml")
    assert (scene.rig.mass, scene.rig.stiffness) == pytest.approx((0.2, 1470.0))
    Path("scenes.toml").unlink()
    assert "cannot be read" in refused(capsys, *asked[:3], "bench/none.toml", *asked[4:])
    Path("other.toml").write_text("effects = []\n")
    assert "is no file of a rig" in refused(capsys, *asked[:3], "other.toml", *asked[4:])
    assert not Path("scenes.toml").exists()


def test_simulated_logs_are_read_back_and_only_they_are_written_over(folder, capsys):
    simulated(capsys, "log.csv")
    quiet = read_log("log.csv")
    words = simulated(capsys, "log.csv", "--noise", "5 mN", "--seed", "3")
    assert "1001 samples" in words
    simulated(capsys, "log.h5", "--noise", "0.005", "--seed", "3")
    noisy, same = read_log("log.csv"), read_log("log.h5")
    assert (noisy.friction_force == same.friction_force).all() and len(noisy) == 1001
    assert noisy.metadata["seed"] == 3
    spread = (noisy.friction_force - quiet.friction_force).std()
    assert 0.0045 < spread < 0.0055
    assert noisy.drive_speed == 1e-3
    arguments = ["simulate", "--scene", examples.SCENE, *RIG, "--duration", "1", "--rate", "100", "--out", "a.csv"]
    code, out, err = stickslip(capsys, *arguments, "--json")
    assert code == 0 and json.loads(out)["rows"] == 101 and "101 samples" in err, "words go to standard error"
    measured = replace(noisy, metadata={**noisy.metadata, "simulated": False})
    for name, write in (("log.csv", write_csv), ("log.h5", write_hdf5)):
        Path(name).unlink()
        write(measured, Path(name))
        before = Path(name).read_bytes()
        assert "may hold a measured log" in refused(capsys, *arguments[:-1], name)
        assert Path(name).read_bytes() == before
    assert "may hold a measured log" in refused(capsys, "convert", LOGS[0], "--out", "log.h5")


def cetr(folder, name="Anna Meier.txt", rows=60):
    path = folder / name
    random = np.random.default_rng(3)
    lines = [f"{i / 50:.4f},{random.normal(50, 5):.4f},-200.1,0.25,{i / 7:.6f}" for i in range(rows)]
    path.write_text(HEAD + "\n".join(lines) + "\n")
    return path


def same_numbers(record, other):
    for name, values in record.columns().items():
        assert values.tobytes() == other.columns()[name].tobytes(), name


def test_anonymous_files_name_nobody(tmp_path, capsys):
    folder = tmp_path / "Anna"
    folder.mkdir()
    source, out = cetr(folder), tmp_path / "log.h5"
    assert stickslip(capsys, "convert", source, "--out", out, "--anonymise")[0] == 0
    record, back = read_log(source), read_log(out)
    raw = out.read_bytes()
    for word in ("Anna", "Meier", "meier", "secret", "skin", "V07", "12 May 2022", record.metadata["sha256"]):
        assert word.encode() not in raw and word not in json.dumps(back.about(), default=str), word
    same_numbers(Record(record.time, record.normal_force, record.friction_force), back)
    assert dict(back.steps[0].parameters) == {"Set Force": "-200", "Velocity": "2", "Duration": "2.17"}
    assert set(back.channels) == {"COF", "channel 2"} and back.metadata["friction_force_source"] == "column Fx in g"
    np.testing.assert_array_equal(back.channels["channel 2"], record.channels["Annas Kanal"])
