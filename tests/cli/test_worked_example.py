"""docs/worked_example.md: its scene and its commands are run on the record, and what it says they print, they print."""

import json
import re
from pathlib import Path

import pytest

from experiments.measured_records import RECORDS
from identify import Scene, fit

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "worked_example.md").read_text(encoding="utf-8")
RECORD = RECORDS / "k168_v42.csv"
ROWS = {  # what begins a row of its table: parameter, and the unit of the page in SI
    "strength after the typical rest": ("strength", 1.0),
    "its scatter": ("strength_scatter", 0.01),
    "weakening length": ("weakening_length", 1e-6),
    "moving mass": ("mass", 1e-3),
    "drift of the level": ("level_wander", 1e-3**-0.5),
    "roughness": ("level_roughness", 1.0),
}

pytestmark = [
    pytest.mark.usefixtures("shared_machine_code"),
    pytest.mark.skipif(not RECORD.is_file(), reason="the measured records are not beside this checkout"),
]


def _cells(begins):
    (row,) = re.findall(rf"^\| {begins}.*?\|$", PAGE, re.MULTILINE)
    return [cell.strip() for cell in row.strip("|").split("|")]


def _numbers(cell, size):
    """The numbers of a cell in SI, and what one more in the last figure is."""
    told = re.findall(r"\d+\.?\d*", cell)
    return [float(n) * size for n in told], max(size * 10.0 ** -len(n.partition(".")[2]) for n in told)


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    folder = tmp_path_factory.mktemp("example")
    (block,) = re.findall(r"```toml\n(.*?)```", PAGE, re.DOTALL)
    (folder / "paper.toml").write_text(block, encoding="utf-8")
    (folder / RECORD.name).symlink_to(RECORD)
    heard = []
    result = fit(
        Scene.from_toml(folder / "paper.toml", ["fit.time_limit=600"]),
        progress=lambda stage, _share: heard.append(str(stage)),
    ).result
    return json.loads(json.dumps(result)), heard


@pytest.mark.slow
def test_the_fit_answers_what_the_page_says(found):
    result, heard = found
    assert result["status"] == "converged" and result["estimator"] == "uneven"
    assert any(said.startswith("friction differs from cycle to cycle") for said in heard)
    for begins, (name, size) in ROWS.items():
        (_, value, interval, verdict), told = _cells(begins), result["parameters"][name]
        for cell, numbers in ((value.split(" per ")[0], [told["value"]]), (interval, told["interval"])):
            shown, last = _numbers(cell, size)
            assert numbers == pytest.approx(shown, abs=last), name  # the last figure may hang on the machine
        assert told["verdict"] == verdict
    for name in ("mu_s", "mu_k0", "D", "t_cr", "delta_mu_k", "a"):
        assert result["parameters"][name]["verdict"] == "not identifiable" and result["parameters"][name]["reason"]
    bound = float(re.search(r"below (\S+) s; that is so if", result["parameters"]["t_cr"]["reason"])[1])
    assert f"t_cr would be below {bound:.1f} s" in " ".join(PAGE.split())
