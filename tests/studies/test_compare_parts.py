"""stickslip compare with fits whose parameters differ between people or logs, and with fits that tell nothing."""

from __future__ import annotations

import numpy as np
import pytest

from identify.studies.compare import ComparisonQuestion, compare, count, parts, read_fits
from identify.studies.operating_points import NOTHING, common, group_answers
from identify.studies.pooled import DIFFERENT, NOT_DISTINGUISHED
from tests.support.comparing_case import NAMES, document, write_fit

pytestmark = pytest.mark.usefixtures("no_further_logs")

OWN = ("mu_s", "D")
SD = np.array([2e-3, 1e-3, 1e-3, 0.01, 0.015, 0.02])
CENTRE = np.array([0.62, 0.45, -0.12, np.log(300.0), np.log(4e-5), np.log(0.5)])
PEOPLE = {"V07": 0.0, "V08": 0.08, "V09": 0.03}


def joint(random, material, raised=0.0, per="volunteer", people=PEOPLE):
    """A fit of two logs of every person: mu_s and D of each person or log, the rest shared."""
    groups = list(people) if per == "volunteer" else [f"log {k + 1}" for k in range(2 * len(people))]
    who = [person for person in people for _ in range(2)]
    whose = dict(zip(groups, people if per == "volunteer" else who, strict=True))
    labels = [{"material": material, "volunteer": person} for person in who]
    R = np.full((6, 6), 0.3) + 0.7 * np.eye(6)
    told = None
    for place, group in enumerate(groups):
        values = CENTRE + SD * random.standard_normal(6)
        values[[0, 4]] += people[whose[group]] + raised
        one = document(values, R * np.outer(SD, SD), {})
        if told is None:
            told = one
            told["logs"] = [
                told["logs"][0] | {"path": f"{k}.csv", "sha256": f"{random.integers(2**62):064x}", "labels": mine}
                for k, mine in enumerate(labels)
            ]
        for name in OWN:
            key = name if place == 0 else f"{name} ({group})"
            told["parameters"][key] = one["parameters"][name] | {"group": group, "per": per}
            if place:
                told["parameters"][key]["parameter"] = name
    told["correlation"] = None
    return told


def study(folder, raised=0.0, per="volunteer"):
    random = np.random.default_rng(3)
    for material, shift in (("PE", 0.0), ("PP", raised)):
        for k in (1, 2):
            write_fit(folder / f"{material}{k}", joint(random, material, shift, per))
    return read_fits([folder])


@pytest.mark.parametrize("per", ["volunteer", "log"])
@pytest.mark.parametrize(("raised", "verdict"), [(0.0, NOT_DISTINGUISHED), (0.1, DIFFERENT)])
def test_values_of_each_person_are_pooled_over_people(tmp_path, per, raised, verdict):
    """Two materials on the same people: the same where nothing was raised; control: different where it was."""
    found = compare(study(tmp_path, raised, per), ComparisonQuestion("material"))
    assert [q.quantity.name for q in found.quantities if q.quantity.name not in NAMES] == []
    assert {q.quantity.name: q.quantity.logarithmic for q in found.quantities}["D"]
    for name in OWN:
        pooled = found.answered[name]
        assert [d.verdict for d in pooled.differences] == [verdict]
        assert [m.subjects for m in pooled.means] == [3, 3]
        assert [m.fits for m in pooled.means] == [6, 6] if per == "volunteer" else [12, 12]
    assert found.selected.people == 3
    assert found.selected.setting.subject.count("V08") == (4 if per == "volunteer" else 8)


@pytest.mark.usefixtures("reasons_only")
def test_what_all_logs_share_counts_once(tmp_path):
    found = compare(study(tmp_path), ComparisonQuestion("material"))
    assert [m.fits for m in found.answered["t_cr"].means] == [2, 2]
    assert all(q.missing == () for q in found.quantities)  # what another part tells is not missing
    assert count(found.selected.entries) == 4 and len(found.selected.entries) == 16
    assert found.selected.notes == (
        "4 fits have some parameters of several volunteers at once; there each is one person.",
    )
    assert all(answer.reason == "" for answer in group_answers(found, common(found)))


@pytest.mark.usefixtures("reasons_only")
def test_people_of_joint_fits_are_compared(tmp_path):
    found = compare(study(tmp_path), ComparisonQuestion("volunteer"))
    assert found.groups == ("V07", "V08", "V09")
    means = {m.group: m.value for m in found.answered["mu_s"].means}
    assert means["V08"] - means["V07"] == pytest.approx(0.08, abs=5e-3)
    assert "t_cr" not in found.answered
    assert dict(found.selected.left_out)["PE1"] == (
        "what its logs share (mu_k0, delta_mu_k, a, t_cr) is of no one volunteer"
    )
    for answer in group_answers(found, common(found)):
        assert answer.critical_speed == NOTHING
        assert answer.reason.endswith(": its fits have one value for several volunteers")


def test_a_part_has_its_own_labels_logs_and_correlations(tmp_path):
    study(tmp_path)
    (entry,) = read_fits([tmp_path / "PE1"])
    told = parts(entry)
    assert [p.name for p in told] == ["PE1", *(f"PE1, volunteer {v}" for v in PEOPLE)]
    second = told[2]
    assert second.labels == {"material": "PE", "volunteer": "V08"} and second.mixed == ()
    assert [log.path for log in second.fitted_logs] == ["2.csv", "3.csv"]
    assert second.result.parameters["D"] == entry.result.parameters["D (V08)"]
    assert set(told[0].result.parameters) == set(NAMES) - set(OWN)


def test_a_fit_of_one_person_stays_whole(tmp_path):
    write_fit(tmp_path / "one", joint(np.random.default_rng(0), "PE", people={"V07": 0.0}))
    (entry,) = read_fits([tmp_path])
    assert parts(entry) == (entry,)
