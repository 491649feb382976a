"""stickslip compare: what is read, what is compared, and that no label does harm in any file it writes."""

from __future__ import annotations

import csv
import json
import re
import shutil
import zipfile
from html.parser import HTMLParser
from xml.etree import ElementTree

import numpy as np
import pytest

from experiments.pooling_draws import Plan, draw
from identify.base.document import to_dict
from identify.cli.folder import COMPARISON, check_replaceable
from identify.cli.main import main
from identify.studies.compare import compare
from identify.studies.comparison_page import write_batch_report, write_comparison
from identify.studies.fits import read_fits
from identify.studies.labels import CompareError, ComparisonQuestion, usual
from identify.studies.operating_points import NOTHING, Answers, GroupAnswer, common, group_answers, probability
from identify.studies.reporting import items
from tests.support.comparing_case import document, write_fit, write_study

pytestmark = pytest.mark.usefixtures("no_further_logs")

SMALL = Plan("small", volunteers=4, runs=2, gap=4.0)
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


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    folder = tmp_path_factory.mktemp("study")
    return folder, write_study(folder, SMALL, curves=True)


def test_materials_are_told_apart_and_the_truth_is_covered(study):
    folder, truth = study
    found = compare(read_fits([folder]), ComparisonQuestion("material"))
    assert found.groups == ("M1", "M2", "M3") and found.taken.subject == "volunteer"
    for k, name in enumerate(("mu_s", "mu_k0", "delta_mu_k", "a", "D", "t_cr")):
        pooled = found.answered[name]
        assert {m.subjects for m in pooled.means} == {4}
        for mean in pooled.means:
            sd = abs(mean.value - truth[int(mean.group[1]) - 1, k]) / mean.error
            assert sd < 4.5
    ends = [d for d in found.answered["mu_s"].differences if {d.first, d.second} == {"M1", "M3"}]
    assert [d.verdict for d in ends] == ["different"]


def test_logarithms_are_pooled_as_logarithms(study):
    found = compare(read_fits([study[0]]), ComparisonQuestion("material"))
    assert {q.name: q.logarithmic for q in found.values.quantities} == {
        "mu_s": False,
        "mu_k0": False,
        "delta_mu_k": False,
        "a": True,
        "D": True,
        "t_cr": True,
    }
    first = found.taken.entries[0]
    index = next(k for k, q in enumerate(found.values.quantities) if q.name == "D")
    assert found.values.y[0, index] == pytest.approx(np.log(first.document["parameters"]["D"]["value"]))


def test_rejected_and_untold_fits_are_named(tmp_path):
    write_study(tmp_path, SMALL)
    random = np.random.default_rng(0)
    one = draw(SMALL, random)
    bad = document(one.y[0], one.noise[0], {"material": "M1", "volunteer": "V1"})
    write_fit(tmp_path / "misfit", bad | {"status": "model_misfit", "message": "cycle 3 of log 1 is off"})
    write_fit(tmp_path / "nameless", document(one.y[0], one.noise[0], {"volunteer": "V1"}))
    weak = document(one.y[0], one.noise[0], {"material": "M1", "volunteer": "V1"})
    weak["parameters"]["D"] |= {"verdict": "not identifiable", "standard_error": None, "interval": [None, None]}
    write_fit(tmp_path / "no_D", weak)
    (tmp_path / "broken").mkdir()
    (tmp_path / "broken" / "result.json").write_text('{"status": "conv')
    two = document(one.y[0], one.noise[0], {"material": "M1", "volunteer": "V1"})
    two["logs"][1]["labels"]["material"] = "M2"
    write_fit(tmp_path / "two", two)
    found = compare(read_fits([tmp_path]), ComparisonQuestion("material", without=("M1_V1_0",)))
    reasons = dict(found.taken.left_out)
    assert reasons["misfit"] == "model misfit: cycle 3 of log 1 is off"
    assert reasons["nameless"] == "it has no label material"
    assert reasons["two"] == "its logs differ in material"
    assert reasons["M1_V1_0"] == "left out as asked"
    assert "cannot be read" in reasons["broken"]
    untold = {q.quantity.name: q.untold for q in found.quantities}
    assert untold["D"] == (("no_D", "not identifiable"),) and untold["mu_s"] == ()


def test_an_index_gives_labels_and_reasons(tmp_path):
    one = draw(SMALL, np.random.default_rng(0))
    write_fit(tmp_path / "a", document(one.y[0], one.noise[0], {}))
    rows = [
        ["group", "status", "message", "result", "folder", "logs", "material", "label: status", "seconds"],
        ["a", "converged", "", "a/result.json", "a", "2", "'=steel", "wet", "1.0"],
        ["b", "time_limit", "took longer than 60 s", "", "b", "2", "wood", "dry", ""],
    ]
    with (tmp_path / "index.csv").open("w", newline="") as handle:
        csv.writer(handle).writerows(rows)
    first, second = read_fits([tmp_path])
    assert first.labels == {"material": "=steel", "status": "wet"} and first.converged
    assert (second.status, second.message) == ("time_limit", "took longer than 60 s")
    assert usual((first, second)) is None
    groups = [{"group": "a", "folder": "a", "labels": {"material": "two\nlines"}}, {"group": "b\n", "folder": "b"}]
    (tmp_path / "batch.json").write_text(json.dumps({"groups": groups}))
    first, second = read_fits([tmp_path])
    assert first.labels == {"material": "two\nlines"} and second.name == "b\n"


def test_labels_that_differ_between_the_logs_of_a_fit_are_no_labels(tmp_path):
    one = draw(SMALL, np.random.default_rng(0))
    told = document(one.y[0], one.noise[0], {"material": "A"})
    told["logs"][1]["labels"] = {"material": "B"}
    write_fit(tmp_path / "a", told)
    (tmp_path / "index.csv").write_text(
        "group,status,message,result,folder,logs,material\na,converged,,a/result.json,a,2,A; B\n"
    )
    (entry,) = read_fits([tmp_path])
    assert "material" not in entry.labels and entry.mixed == ("material",)


def test_fits_of_the_same_logs_are_named(tmp_path):
    write_study(tmp_path, SMALL)
    assert not any(
        "same logs" in note for note in compare(read_fits([tmp_path]), ComparisonQuestion("material")).taken.notes
    )
    shutil.copytree(tmp_path / "M1_V1_0", tmp_path / "copy")
    notes = compare(read_fits([tmp_path]), ComparisonQuestion("material")).taken.notes
    assert "copy and M1_V1_0 are fits of the same logs: leave out one." in notes


def test_covariates_are_used_where_all_have_them(tmp_path):
    one = draw(SMALL, np.random.default_rng(3))
    for i in range(len(one.y)):
        labels = {"material": one.setting.group[i], "volunteer": one.setting.subject[i], "hydration": f"{30 + i % 7} %"}
        labels |= {"site": "palm" if i % 2 else "arm"}
        write_fit(tmp_path / f"f{i}", document(one.y[i], one.noise[i], labels))
    entries = read_fits([tmp_path])
    assert set(compare(entries, ComparisonQuestion("material")).taken.adjusted) == {"hydration", "site"}
    assert compare(entries, ComparisonQuestion("material", adjust=("none",))).taken.adjusted == ()
    asked = compare(entries, ComparisonQuestion("material", adjust=("site", "hydration"))).taken
    assert asked.adjusted == ("site", "hydration") and set(asked.setting.factors) == {"site"}


def test_the_nonlinear_model_answers_at_common_points(study):
    found = compare(read_fits([study[0]]), ComparisonQuestion("material"))
    ground = common(found, speeds=(1e-3, 1e-2), normal_force=1.0)
    answers = group_answers(found, ground)
    assert [a.group for a in answers] == ["M1", "M2", "M3"] and not any(a.reason for a in answers)
    from identify.model.model import assemble
    from identify.prediction.predict import predict

    values = dict(ground.values) | {
        q.name: q.shown(found.answered[q.name].means[0].value) for q in found.values.quantities
    }
    assert found.answered["mu_s"].means[0].group == "M1"
    alone = to_dict(predict(assemble(ground.model.effects), values, 1e-3, 1.0))
    assert answers[0].at[0].fall.value == pytest.approx(alone["amplitude"]["peak_to_valley"]["value"], rel=1e-6)
    assert answers[0].critical_speed.value == pytest.approx(alone["stability"]["critical_speed"]["value"], rel=1e-3)
    low, high = answers[0].critical_speed.interval
    wide_low, wide_high = answers[0].critical_speed.people
    assert wide_low < low < answers[0].critical_speed.value < high < wide_high
    curve = answers[0].friction
    v = curve.speed
    kinetic = values["mu_k0"] + values["delta_mu_k"] * -np.expm1(-values["a"] * v)
    aged = np.maximum(1 - v * values["t_cr"] / values["D"], 0.0)  # eq. 2 at rest of gamma
    np.testing.assert_allclose(curve.value, kinetic + (values["mu_s"] - kinetic) * aged, rtol=0.02, atol=0.006)
    assert np.all(curve.low <= curve.value) and np.all(curve.people_low <= curve.low)


def test_the_probability_of_stick_slip_is_students():
    assert probability(1.0, 1.0, (0.5, 2.0), 9.0) == pytest.approx(0.5)
    assert probability(0.5, 1.0, (0.5, 2.0), 9.0) == pytest.approx(0.975)
    assert probability(2.0, 1.0, (0.5, 2.0), 9.0) == pytest.approx(0.025)
    assert probability(1.0, None, None, 9.0) is None


class Plain(HTMLParser):
    """Tags and attributes of a page."""

    def __init__(self, text):
        super().__init__()
        self.tags, self.attributes = [], []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.attributes += [name for name, _ in attrs]


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
        told["parameters"]["<b>=odd"] = told["parameters"]["mu_s"]
        if who == "V1":
            told["logs"][1] |= {"reason_left_out": text, "path": text}
        write_fit(folder / f"f{i}", told)
    write_fit(folder / "failed", told | {"status": "<i>failed", "message": HOSTILE[0]})
    out = tmp_path_factory.mktemp("out")
    found = compare(read_fits([folder]), ComparisonQuestion("material"))
    answers = tuple(GroupAnswer(group, NOTHING, (), None, None, group) for group in found.groups)
    write_comparison(found, Answers(None, answers, HOSTILE[0]), out)
    return out


def test_hostile_labels_do_no_harm_on_the_page(hostile):
    text = (hostile / "report.html").read_text(encoding="utf-8")
    page = Plain(text)
    assert page.tags.count("script") == 1 and "img" not in page.tags and "i" not in page.tags
    assert not [name for name in page.attributes if name.startswith("on")]
    assert not re.search("[\u202a-\u202e\u2066-\u2069\x00\x07]", text)
    assert "x" * 401 not in text and "49" not in re.findall(r"<bdi>(\d+)</bdi>", text)
    assert len(text) < 3_000_000


def test_hostile_labels_do_no_harm_in_tables(hostile):
    for path in (hostile / "tables").glob("*.csv"):
        with path.open(encoding="utf-8", newline="") as handle:
            rows = list(csv.reader(handle))
        assert len({len(row) for row in rows}) == 1, path
        for text in (c for row in rows for c in row):
            number = re.fullmatch(r"-?[\d.]+(e[-+]\d+)?", text)
            assert number or not text.lstrip().startswith(("=", "+", "-", "@", "\t", "|", "%")), (path.name, text[:40])
            assert "\n" not in text and "\r" not in text and len(text) < 2100


def test_hostile_labels_do_no_harm_in_excel(hostile):
    with zipfile.ZipFile(hostile / "comparison.xlsx") as book:
        sheets = [name for name in book.namelist() if name.startswith("xl/worksheets/")]
        assert len(sheets) == 11
        for name in book.namelist():
            root = ElementTree.fromstring(book.read(name))
            tags = {element.tag.rpartition("}")[2] for element in root.iter()}
            assert "f" not in tags and "hyperlink" not in tags  # no formula
            for element in root.iter():
                if element.tag.endswith("}t"):
                    assert not (element.text or "").lstrip().startswith(("=", "+", "-", "@", "|"))
                if element.tag.endswith("}v"):
                    float(element.text)


def test_hostile_labels_do_no_harm_in_latex(hostile):
    text = (hostile / "comparison.tex").read_text(encoding="utf-8")
    assert "\\input" not in text and "\\frac" not in text
    assert text.count("\\begin{longtable}") == text.count("\\end{longtable}") == 4
    bare = re.sub(r"\\.", "", text.split("\n", 1)[1])
    assert bare.count("{") == bare.count("}") and bare.count("$") % 2 == 0 and "#" not in bare


def test_hostile_labels_come_back_from_json(hostile):
    assert HOSTILE[2] in json.loads((hostile / "comparison.json").read_text(encoding="utf-8"))["groups"]


def test_the_command(study, tmp_path, capsys):
    out = tmp_path / "cmp"
    arguments = ["compare", str(study[0]), "--by", "material", "--out", str(out), "--speeds", "1 mm/s", "--json"]
    assert main(arguments) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["status"] == "done" and told["groups"] == ["M1", "M2", "M3"]
    assert {p.name for p in out.iterdir()} == {
        "report.html",
        "comparison.json",
        "comparison.xlsx",
        "comparison.tex",
        "tables",
    }
    check_replaceable(out, COMPARISON)  # a comparison of ours is replaced
    page = (out / "report.html").read_text(encoding="utf-8")
    link = re.search(r'href="([^"]*M1_V1_0/report.html)"', page)
    assert link and (out / link[1]).resolve() == (study[0] / "M1_V1_0" / "report.html").resolve()


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (["--by", "colour"], "no converged fit has the label 'colour'; expected one of: material, volunteer"),
        (["--by", "material", "--adjust", "moisture"], "no converged fit has the label 'moisture'"),
        (["--by", "material", "--without", "nobody"], "no fit is called 'nobody'"),
        (["--by", "material", "--speeds", "fast"], "--speeds"),
        (["--by", "material", "--load", "-1 N"], "--load is -1 N; expected a positive number"),
    ],
)
def test_what_cannot_be_asked_is_one_sentence(study, tmp_path, capsys, more, words):
    assert main(["compare", str(study[0]), "--out", str(tmp_path / "x"), *more]) == 2
    said = capsys.readouterr().err.strip().splitlines()[-1]
    assert words in said and not (tmp_path / "x").exists()


def test_folders_that_hold_nothing(tmp_path, capsys):
    assert main(["compare", str(tmp_path / "gone"), "--by", "material"]) == 2
    (tmp_path / "empty").mkdir()
    assert main(["compare", str(tmp_path / "empty"), "--by", "material", "--out", str(tmp_path / "o")]) == 2
    assert "no fit was found" in capsys.readouterr().err
    (tmp_path / "own").mkdir()
    (tmp_path / "own" / "thesis.docx").write_text("years of work")
    write_study(tmp_path / "study", Plan("tiny", volunteers=2, runs=1))
    assert main(["compare", str(tmp_path / "study"), "--by", "material", "--out", str(tmp_path / "own")]) == 2
    assert (tmp_path / "own" / "thesis.docx").read_text() == "years of work"


def test_the_page_of_a_batch_that_cannot_be_compared(tmp_path):
    one = draw(SMALL, np.random.default_rng(0))
    write_fit(tmp_path / "only", document(one.y[0], one.noise[0], {}))
    text = write_batch_report(tmp_path).read_text(encoding="utf-8")
    assert 'href="only/report.html"' in text and 'id="fits"' in text and 'id="different"' not in text
    assert "≈ weak" in text and "✓" not in text
    assert "missing" in text  # what ASTM G115 asks for
    empty = tmp_path / "nothing"
    empty.mkdir()
    assert write_batch_report(empty).is_file()


def test_a_question_without_an_answer_is_refused():
    with pytest.raises(CompareError, match="no fit was found"):
        compare((), ComparisonQuestion("material"))


def test_what_too_few_fits_tell_is_not_called_untold(tmp_path):
    one = draw(SMALL, np.random.default_rng(0))
    for i, material in enumerate(("M1", "M2")):
        write_fit(tmp_path / material, document(one.y[i], one.noise[i], {"material": material}))
    found = compare(read_fits([tmp_path]), ComparisonQuestion("material"))
    for answer in group_answers(found, common(found)):
        assert answer.reason == (
            "D, a, delta_mu_k, mu_k0, mu_s, t_cr are not pooled: no group has two fits, so that nothing shows the "
            "scatter between runs; add runs to each group"
        )


def test_what_no_fit_of_a_group_tells_is_called_untold(tmp_path):
    one = draw(SMALL, np.random.default_rng(0))
    for i in range(6):
        told = document(one.y[i], one.noise[i], {"material": "M1" if i < 3 else "M2"})
        if i < 3:
            told["parameters"]["D"] |= {"verdict": "not identifiable", "standard_error": None, "interval": [None, None]}
        write_fit(tmp_path / str(i), told)
    found = compare(read_fits([tmp_path]), ComparisonQuestion("material"))
    reasons = {answer.group: answer.reason for answer in group_answers(found, common(found))}
    assert reasons == {"M1": "its fits do not tell D", "M2": ""}


def test_coefficients_of_several_materials_are_not_one_median(tmp_path):
    one = draw(SMALL, np.random.default_rng(0))
    for i, (material, level) in enumerate((("PTFE", 0.2), ("UHMWPE", 0.5), ("UHMWPE", 0.6))):
        told = document(one.y[i], one.noise[i], {"material": material})
        for log in told["logs"]:
            log["classical"] = {"rows": [{"static_peak_coefficient": level}]}
        write_fit(tmp_path / f"fit_{i}", told)
    found = {item.name: item.text for item in items(read_fits([tmp_path])) if item.name.startswith("static")}
    assert list(found) == ["static coefficient, PTFE", "static coefficient, UHMWPE"]
    assert found["static coefficient, PTFE"].startswith("0.2 (median of")
    alone = {item.name: item.text for item in items(read_fits([tmp_path / "fit_0"]))}
    assert alone["static coefficient"].startswith("0.2 (median of")


def test_what_records_of_the_rig_told_is_no_difference_of_materials(tmp_path):
    """A stiffness with a tolerance is searched in each fit; a mass that is searched without one is a finding."""
    for i, (group, mu_s) in enumerate((("glass", 0.5), ("glass", 0.51), ("steel", 0.7), ("steel", 0.71))):
        values = np.array([mu_s, 0.4, -0.1, np.log(300.0), np.log(4e-5), np.log(0.5)])
        told = document(values, np.diag(np.full(6, 1e-4)), {"material": group})
        for name, value in (("mass", 0.2), ("stiffness", 1470.0)):
            found = {"value": value * (1.0 + 0.01 * i), "standard_error": 0.01 * value, "interval": [None, None]}
            told["parameters"][name] = told["parameters"]["mu_s"] | found
        scene = told["provenance"]["scene"]
        stated = {"stiffness": {"value": 1470.0, "tolerance": 0.01}, "damping": 147.0, "mass": 0.2}
        told["provenance"] = {"scene": {**scene, "rig": stated}}
        write_fit(tmp_path / f"{group}_{i}", told)
    comparison = compare(read_fits([tmp_path]), ComparisonQuestion("material"))
    assert {q.quantity.name for q in comparison.quantities} == {"mu_s", "mu_k0", "delta_mu_k", "a", "D", "t_cr", "mass"}
    assert all(not answer.reason for answer in group_answers(comparison, common(comparison)))
