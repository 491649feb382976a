"""The report: every file from a made-up fit, read back with plain tools and compared with what went in."""

from __future__ import annotations

import csv
import json
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from identify.base.document import as_json
from identify.base.result import ParameterResult, Status
from identify.effects import ALL
from identify.report import write_report
from identify.report.figures import pictures
from identify.report.finished import Fit
from identify.report.report_page import LARGEST, render_page
from identify.report.report_tables import parameter_table
from identify.report.report_wording import PLAIN_SYMBOLS, plain_symbol
from identify.report.style import REPORTED, Drawing, extremes
from tests.support.fake_fit import failed, fake_fit, log_curves, with_verdicts, without_cycles

VOID = {"meta", "img", "br", "hr", "link", "input"}
HOSTILE = "<script>alert('x')</script> $\\frac{1}{0}$ & \x00 \"quoted\" 皮膚"


class Page(HTMLParser):
    """What the tests ask of a page: ids, resources, text, unclosed tags, figures without a description."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open, self.ids, self.resources, self.words, self.problems = [], [], [], [], []
        self.feed(text)
        self.text = re.sub(r"\s+", " ", " ".join(self.words))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        found = dict(attrs)
        self.ids += [found["id"]] if "id" in found else []
        self.resources += [found[name] for name in ("src", "href", "xlink:href", "data") if name in found]
        unlabelled = (tag == "th" and not found.get("scope")) or (
            found.get("role") == "img" and "aria-label" not in found
        )
        self.problems += [f"<{tag}>"] if unlabelled or tag in ("script", "iframe", "object") else []
        self.open += [tag] if tag not in VOID else []

    def handle_endtag(self, tag: str) -> None:
        if not self.open or self.open.pop() != tag:
            self.problems.append(f"</{tag}> closes nothing")

    def handle_data(self, data: str) -> None:
        if "style" not in self.open:
            self.words.append(data)


def check_page(text: str) -> Page:
    """The page parses, is self-contained, small enough and labelled."""
    page = Page(text)
    assert not page.problems and not page.open
    assert len(page.ids) == len(set(page.ids))
    assert all(r.startswith(("#", "data:")) for r in page.resources)
    assert all(r[1:] in page.ids for r in page.resources if r.startswith("#"))
    assert "http://" not in text and "https://" not in text and "@import" not in text
    assert len(text.encode()) <= LARGEST
    return page


def strict(text: str) -> Any:
    """JSON as the standard has it: NaN and Infinity are refused."""
    return json.loads(text, parse_constant=lambda name: pytest.fail(f"{name} is no JSON"))


@pytest.fixture(scope="module")
def fit() -> Fit:
    return fake_fit(samples=3000, logs=2, scatter=0.02)


@pytest.fixture(scope="module")
def folder(fit: Fit, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("mit Lücke und ä") / "new" / "report"
    written = write_report(fit, folder)
    assert [path.name for path in written[-2:]] == ["result.json", "report.html"]
    assert sorted(written) == sorted(path for path in folder.rglob("*") if path.is_file())
    return folder


@pytest.fixture(scope="module")
def drawn(fit: Fit) -> list[Drawing]:
    return list(pictures(replace(fit, logs=fit.logs[:1])))


def read_csv(path: Path) -> dict[str, list[str]]:
    with path.open(newline="", encoding="utf-8") as handle:
        rows = list(csv.DictReader(handle))
    return {name: [row[name] for row in rows] for name in rows[0]}


def test_page_is_self_contained_and_shows_the_result(fit: Fit, folder: Path) -> None:
    text = (folder / "report.html").read_text(encoding="utf-8")
    page = check_page(text)
    for word in ("37.42", "µm", "identified", "0.1 mm/min", "χ² per sample", "V07"):
        assert word in page.text
    assert page.text.index("Parameters") < page.text.index("whole log") < page.text.rindex("Classical table")
    with pytest.raises(AssertionError):  # the control
        check_page(text.replace("</main>", '<img src="https://example.org/x.png"></main>'))
    document = strict((folder / "result.json").read_text(encoding="utf-8"))
    assert document["parameters"] == fit.result["parameters"]


def test_json_turns_everything_not_finite_into_null() -> None:
    odd = {"a": float("nan"), "b": [np.inf, np.float32(2)], "c": np.array([1.0, np.nan]), "d": Path("x"), "e": True}
    assert strict(as_json(odd)) == {"a": None, "b": [None, 2.0], "c": [1.0, None], "d": "x", "e": True}
    with pytest.raises(TypeError, match="set"):
        as_json({"a": {1, 2}})


def holds(new: Any, old: Any) -> bool:
    """Whether nothing of a document is lost in another one."""
    if isinstance(old, dict):
        return all(key in new and holds(new[key], value) for key, value in old.items())
    return len(new) == len(old) and all(map(holds, new, old)) if isinstance(old, list) else new == old


def test_a_result_of_an_earlier_version_is_read_whole() -> None:
    """As it was written before the schema of result.json was generated from what reads it."""
    path = Path(__file__).parents[1] / "cases" / "result_of_november.json"
    found, document = Fit.from_json(path), strict(path.read_text(encoding="utf-8"))
    assert holds(found.typed.to_dict(), document) and "0.6" in repr(found)
    check_page(render_page(found, []))
    document["gate"]["another"] = 1  # the control
    assert not holds(found.typed.to_dict(), document)


def test_hdf5_holds_the_document_and_the_curves(fit: Fit, folder: Path) -> None:
    with h5py.File(folder / "result.h5") as file:
        assert file.attrs["format"] == "stickslip-result"
        assert file["document"].asstr()[()] == as_json(fit.result)
        for number_, curves in enumerate(fit.logs, start=1):
            group = file[f"curves/log_{number_}"]
            for name in ("time", "friction_force", "fitted_force", "used"):
                np.testing.assert_array_equal(group[name][:], getattr(curves, name))
            assert group["friction_force"].attrs["units"] == "N"
            np.testing.assert_array_equal(group["cycles/onset"][:], curves.cycles[:, 0])


def test_figures_come_with_their_data(fit: Fit, folder: Path) -> None:
    names = {path.stem for path in (folder / "figures").iterdir() if path.suffix == ".svg"}
    assert {"log_1_force", "log_1_cycles", "log_2_force", "correlation"} <= names
    for name in names - set(REPORTED):
        assert (folder / f"figures/{name}.csv").stat().st_size > 0
    force = read_csv(folder / "figures/log_1_force.csv")
    assert max(float(x) for x in force["measured_N"]) == fit.logs[0].friction_force.max()
    rows = [log["classical"]["rows"][0] for log in fit.result["logs"]]
    assert [float(cell) for cell in read_csv(folder / "classical.csv")["drop_N"]] == [row["drop_N"] for row in rows]


@pytest.mark.parametrize("status", [status for status in Status if status is not Status.CONVERGED])
def test_every_failure_leads_with_reason_and_classical_table(status: Status, fit: Fit, drawn: list[Drawing]) -> None:
    ended = failed(fit, status.value, "Log 2, cycle 3 does not fit; leave it out.")
    page = check_page(render_page(ended, drawn))
    order = [page.text.index(w) for w in ("leave it out", "Classical table", "Where the search stood", "whole log")]
    assert order == sorted(order)
    assert "standard error" not in page.text and "37.42 ±" not in page.text and "SE" not in page.text.split()
    assert strict(as_json(ended.result))["parameters"]["D"]["value"] is None


def test_verdicts_and_open_intervals_are_shown_and_the_least_renders(fit: Fit) -> None:
    text = check_page(render_page(with_verdicts(fit), [])).text
    words = (
        "not identifiable",
        "weak",
        "at bound",
        "fixed",
        "above 112",
        "Not identifiable from these logs",
        "1 kHz or more",
    )
    assert all(word in text for word in words)
    for result in ({"status": "solver_failed"}, {"status": "converged", "logs": [{}], "parameters": {"x": {}}}):
        check_page(render_page(Fit({"schema": 1, **result}, ()), []))


def test_nothing_fitted_still_gives_every_file_and_figures_of_a_log_that_is_gone_go(fit: Fit, tmp_path: Path) -> None:
    (tmp_path / "figures").mkdir()
    (tmp_path / "figures/log_7_force.svg").write_text("old")
    (tmp_path / "figures/my_own.svg").write_text("mine")
    write_report(without_cycles(fit), tmp_path)
    assert not (tmp_path / "figures/log_7_force.svg").exists() and (tmp_path / "figures/my_own.svg").exists()
    page = check_page((tmp_path / "report.html").read_text(encoding="utf-8"))
    assert "No curve was fitted through this log" in page.text and "Classical table" in page.text
    strict((tmp_path / "result.json").read_text(encoding="utf-8"))


def test_every_parameter_has_a_symbol_and_a_meaning() -> None:
    for effect in ALL:
        for p in effect.parameters:
            name = parameter_table({p.name: ParameterResult(p.default, p.unit, verdict="fixed")}).cells[0][0]
            assert name.note and name.shown, p.name
            assert plain_symbol(p.name) in (p.symbol, PLAIN_SYMBOLS.get(p.name))


def test_hostile_labels_stay_text(fit: Fit, tmp_path: Path) -> None:
    logs = [{**log, "path": HOSTILE, "labels": {HOSTILE: HOSTILE}} for log in fit.result["logs"][:1]]
    provenance = {"command": HOSTILE, "scene": {"name": HOSTILE, "x": HOSTILE}}
    parameters = {name: {**entry, "reason": HOSTILE} for name, entry in fit.result["parameters"].items()}
    result = {**fit.result, "message": HOSTILE, "logs": logs, "provenance": provenance, "parameters": parameters}
    write_report(Fit(result, (replace(fit.logs[0], name=HOSTILE),)), tmp_path)
    page = check_page((tmp_path / "report.html").read_text(encoding="utf-8"))
    assert "<script>alert('x')</script>" in page.text  # as words, not as a tag: check_page refuses the tag
    assert strict((tmp_path / "result.json").read_text(encoding="utf-8"))["message"] == HOSTILE


def test_a_long_log_keeps_its_spike_and_the_page_small() -> None:
    curves = log_curves(1e-3, 300_000, cycles=40)
    force = curves.friction_force.copy()
    force[177_777] = 9.0
    one = fake_fit(samples=500, logs=1)
    long = Fit(one.result, (replace(curves, friction_force=force),))
    drawn = list(pictures(long))
    text = render_page(long, drawn)
    check_page(text)
    assert len(text.encode()) < 700_000
    assert np.max(drawn[0].tables["log_1_force"]["measured_N"]) == 9.0
    assert 9.0 not in force[::1000]  # every thousandth sample would have lost it


def test_the_extremes_of_every_stretch_are_kept() -> None:
    values = np.random.default_rng(3).standard_normal(10_000)
    values[2000:3000] = np.nan
    kept = extremes(values, 50)
    assert len(kept) <= 100 and {np.nanargmin(values), np.nanargmax(values)} <= set(kept)
    finite = values[np.isfinite(values)].reshape(50, -1)
    assert set(finite.min(axis=1)) | set(finite.max(axis=1)) == set(values[kept])
    assert len(extremes(values[:150], 100)) == 150


def test_interruption_leaves_no_half_file(fit: Fit, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    small = without_cycles(Fit(fit.result, fit.logs[:1]))
    write_report(small, tmp_path)
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}

    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("data_io.atomic.os.replace", stop)  # each file is whole before it has its name
    with pytest.raises(KeyboardInterrupt):
        write_report(small, tmp_path)
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}.keys() == before.keys()
    assert (tmp_path / "result.h5").read_bytes() == before[tmp_path / "result.h5"]
    with pytest.raises(KeyboardInterrupt):
        write_report(small, tmp_path / "fresh")
    assert not [p for p in (tmp_path / "fresh").iterdir() if p.name != "figures"]
