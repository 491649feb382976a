"""stickslip compare: what is read, what is compared, and that no label does harm in any file it writes."""

from __future__ import annotations

import json
import re
import shutil
from html.parser import HTMLParser

import numpy as np
import pytest

from experiments.pooling_draws import Plan, draw
from identify.cli.arguments import COMPARISON, check_replaceable
from identify.cli.main import main
from identify.studies.compare import ComparisonQuestion, compare, read_fits
from identify.studies.comparison_page import comparison_tables, write_comparison
from tests.support.command import stickslip
from tests.support.comparing_case import document, write_fit, write_study

SMALL = Plan("small", volunteers=4, runs=2, gap=4.0)
NAMES = ("mu_s", "mu_k0", "delta_mu_k", "a", "D", "t_cr")
BY_MATERIAL = ComparisonQuestion("material")
WITHOUT_VALUE = {"verdict": "not identifiable", "standard_error": None, "interval": [None, None]}
HOSTILE = (
    "<script>alert(1)</script>",
    '"><img src=x onerror=alert(1)>',
    "=cmd|'/C calc'!A0",
    "+1+1",
    "-2+3",
    "@SUM(A1)",
    "\t=1",
    "a\nb\r\nc",
    "abc\u202etxt.exe\u2066",
    "x" * 10_000,
    "\\input{/etc/passwd} $\\frac{1}{0}$ 100% & #_{}~^",
    "nul\x00bell\x07",
    "{{ 7 * 7 }}{% raw %}",
    "]]>&lt;",
    "\ud800half".encode("utf-16", "surrogatepass").decode("utf-16", "replace"),
    "皮膚 جلد",
)


def one_of(material="M1", place=0, seed=0, **labels):
    """The document of one drawn fit."""
    study = draw(SMALL, np.random.default_rng(seed))
    return document(study.y[place], study.noise[place], {"material": material, **labels} if material else labels)


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    folder = tmp_path_factory.mktemp("study")
    return folder, write_study(folder, SMALL)


def test_materials_differ_and_the_truth_is_covered(study):
    folder, truth = study
    found = compare(read_fits([folder]), BY_MATERIAL)
    assert found.groups == ("M1", "M2", "M3") and found.selected.subject == "volunteer"
    assert {q.name: q.logarithmic for q in found.quantities} == dict.fromkeys(NAMES[:3], False) | dict.fromkeys(
        NAMES[3:], True
    )
    first = found.selected.entries[0].result.parameters["D"].value
    assert found.answered["D"].y[0] == pytest.approx(np.log(first))
    for k, name in enumerate(NAMES):
        for mean in found.answered[name].means:
            assert mean.subjects == 4 and abs(mean.value - truth[int(mean.group[1]) - 1, k]) < 4.5 * mean.error
    ends = [d for d in found.answered["mu_s"].differences if {d.first, d.second} == {"M1", "M3"}]
    assert [d.verdict for d in ends] == ["different"]
    frame = comparison_tables(found)["parameters"].to_frame().set_index(["parameter", "material"])
    for name, factor in (("D", np.exp), ("mu_s", lambda _: 1.0)):  # errors of logarithms times the mean
        mean = found.answered[name].means[0]
        row = frame.loc[(name, mean.group), ["standard error", "scatter of its fits"]].tolist()
        assert row == pytest.approx([mean.error * factor(mean.value), mean.scatter * factor(mean.value)])


def test_fits_that_are_not_compared_are_named_with_the_reason(tmp_path):
    write_study(tmp_path, SMALL)
    write_fit(tmp_path / "misfit", one_of() | {"status": "model_misfit", "message": "cycle 3 of log 1 is off"})
    write_fit(tmp_path / "nameless", one_of(None, volunteer="V1"))
    weak, two, empty = (one_of(volunteer="V1") for _ in range(3))
    weak["parameters"]["D"] |= WITHOUT_VALUE
    two["logs"][1]["labels"]["material"] = "M2"
    for parameter in empty["parameters"].values():
        parameter |= WITHOUT_VALUE
    for name, told in (("no_D", weak), ("two", two), ("empty", empty)):
        write_fit(tmp_path / name, told)
    (tmp_path / "broken").mkdir()
    (tmp_path / "broken" / "result.json").write_text('{"status": "conv')
    shutil.copytree(tmp_path / "M1_V1_1", tmp_path / "copy")
    found = compare(read_fits([tmp_path]), ComparisonQuestion("material", without=("M1_V1_0",)))
    reasons = dict(found.selected.left_out)
    assert reasons["misfit"] == "model misfit: cycle 3 of log 1 is off"
    assert reasons["nameless"] == "it has no label material"
    assert reasons["two"] == "its logs differ in material; fit each material on its own"
    assert reasons["M1_V1_0"] == "left out by --without"
    assert reasons["empty"] == f"it has no value to compare: {', '.join(NAMES)} not identifiable"
    assert "cannot be read" in reasons["broken"] and len(reasons) == 6
    missing = {q.name: q.missing for q in found.quantities}
    assert missing["D"] == (("no_D", "not identifiable"),) and missing["mu_s"] == ()
    assert "M1_V1_1 and copy are fits of the same logs: leave out one." in found.selected.notes or (
        "copy and M1_V1_1 are fits of the same logs: leave out one." in found.selected.notes
    )


def test_a_batch_gives_labels_and_reasons(tmp_path):
    told = one_of(None)
    told["logs"][1]["labels"] = {"run": "2"}
    write_fit(tmp_path / "a", told)
    (tmp_path / "b").mkdir()
    (tmp_path / "b" / "job.json").write_text('{"status": "timed_out", "message": "took longer than 60 s"}')
    groups = [
        {"group": "a\n", "folder": "a", "status": "converged", "labels": {"material": "=steel\n", "run": "1; 2"}},
        {"group": "b", "folder": "b", "status": "waiting"},
        {"group": "c", "folder": "c", "status": "waiting"},
        {"group": "d", "folder": "d", "status": "converged"},
    ]
    (tmp_path / "batch.json").write_text(json.dumps({"groups": groups}))
    first, second, third, gone = read_fits([tmp_path])
    assert first.name == "a\n" and first.labels == {"material": "=steel\n"} and first.converged
    assert first.mixed == ("run",), "labels that differ between the logs of a fit are none of the fit"
    assert (second.status, second.message) == ("timed_out", "took longer than 60 s")
    assert third.message == "the batch has not come to it"
    assert not gone.converged and gone.message == "result.json is missing"
    assert len(read_fits([tmp_path, tmp_path / "a"])) == 4


def test_what_of_a_joint_fit_differs_between_its_logs_is_not_compared(tmp_path):
    for place in range(4):
        told = one_of(f"M{place % 2}", place)
        told["parameters"]["mu_s"] |= {"per": "volunteer", "group": "V1"}
        told["parameters"]["mu_s (V2)"] = told["parameters"]["mu_s"] | {"group": "V2", "parameter": "mu_s"}
        write_fit(tmp_path / f"fit {place}", told)
    found = compare(read_fits([tmp_path]), BY_MATERIAL)
    assert [q.name for q in found.quantities] == [*NAMES[1:]]


def test_what_measurements_of_the_rig_gave_is_no_difference_of_materials(tmp_path):
    """A stiffness with a tolerance is searched in each fit; a mass that is searched without one is a finding."""
    for i, (group, mu_s) in enumerate((("glass", 0.5), ("glass", 0.51), ("steel", 0.7), ("steel", 0.71))):
        values = np.array([mu_s, 0.4, -0.1, np.log(300.0), np.log(4e-5), np.log(0.5)])
        told = document(values, np.diag(np.full(6, 1e-4)), {"material": group})
        for name, value in (("mass", 0.2), ("stiffness", 1470.0)):
            found = {"value": value * (1.0 + 0.01 * i), "standard_error": 0.01 * value, "interval": [None, None]}
            told["parameters"][name] = told["parameters"]["mu_s"] | found
        stated = {"stiffness": {"value": 1470.0, "tolerance": 0.01}, "damping": 147.0, "mass": 0.2}
        told["provenance"] = {"scene": {**told["provenance"]["scene"], "rig": stated}}
        write_fit(tmp_path / f"{group}_{i}", told)
    comparison = compare(read_fits([tmp_path]), BY_MATERIAL)
    assert {q.name for q in comparison.quantities} == {*NAMES, "mass"}


@pytest.fixture(scope="module")
def hostile(tmp_path_factory):
    """A comparison whose groups, people, fits, messages and label names are hostile."""
    folder = tmp_path_factory.mktemp("hostile")
    one = draw(Plan("h", materials=len(HOSTILE), volunteers=2, runs=1), np.random.default_rng(4))
    for i, (group, who) in enumerate(zip(one.setting.group, one.setting.subject, strict=True)):
        text = HOSTILE[int(group[1:]) - 1]
        labels = {"material": text, "volunteer": f"{who}{text}", "=lab<b>el\u202e\n": text, "counterface": text}
        told = document(one.y[i], one.noise[i], labels)
        told["message"] = text
        told["parameters"] = {name: told["parameters"][name] for name in ("mu_s", "D")}
        told["parameters"]["<b>=odd"] = told["parameters"]["mu_s"]
        if who == "V1":
            told["logs"][1] |= {"reason_left_out": text, "path": text}
        write_fit(folder / f"f{i}", told)
    write_fit(folder / "failed", told | {"status": "<i>failed", "message": HOSTILE[0]})
    out = tmp_path_factory.mktemp("out")
    found = compare(read_fits([folder]), BY_MATERIAL)
    write_comparison(found, out)
    return out


def test_hostile_labels_do_no_harm_on_the_page(hostile):
    text = (hostile / "report.html").read_text(encoding="utf-8")
    tags, attributes = [], []
    page = HTMLParser()
    page.handle_starttag = lambda tag, attrs: (tags.append(tag), attributes.extend(name for name, _ in attrs))
    page.feed(text)
    assert tags.count("script") == 1 and not {"img", "i"} & set(tags)
    assert not [name for name in attributes if name.startswith("on")]
    assert not re.search("[\u202a-\u202e\u2066-\u2069\x00\x07]", text)
    assert "x" * 401 not in text and "49" not in re.findall(r"<bdi>(\d+)</bdi>", text)
    assert len(text) < 3_000_000
    assert HOSTILE[2] in json.loads((hostile / "comparison.json").read_text(encoding="utf-8"))["groups"]


def test_the_command(study, tmp_path, capsys):
    out = tmp_path / "cmp"
    arguments = ["compare", str(study[0]), "--by", "material", "--out", str(out), "--json"]
    assert main(arguments) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["status"] == "done" and told["groups"] == ["M1", "M2", "M3"] and told["compared"] == told["fits"] == 24
    files = {"report.html", "comparison.json", "comparison.xlsx", "comparison.tex", "tables"}
    assert {p.name for p in out.iterdir()} == files
    check_replaceable(out, COMPARISON)  # a comparison of ours is replaced
    page = (out / "report.html").read_text(encoding="utf-8")
    parts = re.findall(r'href="#([^"]+)"', page)
    assert len(parts) >= 4 and all(f'id="{part}"' in page for part in parts), "its contents lead to its parts"
    link = re.search(r'href="([^"]*M1_V1_0/report.html)"', page)
    assert link and (out / link[1]).resolve() == (study[0] / "M1_V1_0" / "report.html").resolve()


def test_a_question_that_cannot_be_answered_is_one_sentence(study, tmp_path, capsys):
    (tmp_path / "empty").mkdir()
    (tmp_path / "own").mkdir()
    (tmp_path / "own" / "thesis.docx").write_text("years of work")
    by = ["--by", "material"]
    for source, out, more, words in (
        (study[0], "x", ["--by", "colour"], "no converged fit has the label 'colour'; expected one of: material, vol"),
        (study[0], "x", [*by, "--without", "nobody"], "no fit is called 'nobody'"),
        (tmp_path / "gone", "x", by, "does not exist"),
        (tmp_path / "empty", "x", by, "no fit was found"),
        (study[0], "own", by, "own"),
    ):
        code, _, err = stickslip(capsys, "compare", source, "--out", tmp_path / out, *more)
        assert code == 2 and words in err.splitlines()[-1]
    assert not (tmp_path / "x").exists() and (tmp_path / "own" / "thesis.docx").read_text() == "years of work"
