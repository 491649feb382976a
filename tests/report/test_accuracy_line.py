"""What accuracy costs, in front of everyone: estimated from the blocks of a fit, checked against solves of levels."""

import numpy as np
import pytest

from identify import Asked, Scene, examples, fit
from identify.base.result import Result
from identify.report.report_page import first_screen
from identify.report.summary import accuracy_text, summary


@pytest.fixture(scope="module")
def result():
    """A fit, and the table of what the levels leave where each is solved."""
    return fit(Scene.from_toml(examples.SCENE), asked=Asked(accuracy_table=True)).result


def test_the_error_that_other_levels_would_leave_is_what_they_leave(result):
    """Within 30 %, of the largest error of all parameters; a finer level is never cheaper, and leaves no more."""
    told = {level["accuracy"]: level for level in result["accuracy"]["levels"]}
    assert list(told) == ["coarse", "default", "tight"] and result["accuracy"]["taken"] == "default"
    assert [told[name]["estimated"] for name in told] == [True, False, True]
    for entry in result["accuracy_table"]:
        left = max(abs(error) for error in entry["left_in_standard_errors"].values())
        assert told[entry["accuracy"]]["error_in_standard_errors"] == pytest.approx(left, rel=0.3)
        assert told[entry["accuracy"]]["steps"] == entry["steps"]
    assert np.all(np.diff([level["error_in_standard_errors"] for level in told.values()]) <= 0.0)
    for levels in (list(told.values()), result["accuracy_table"]):
        assert np.all(np.diff([level["seconds"] for level in levels]) >= 0.0)
    assert told["default"]["seconds"] < result["timing_s"]["total"], "the table is no part of the fit"


def test_it_stands_in_the_summary_and_on_the_first_screen(result):
    told = Result.from_dict(result)
    line = accuracy_text(told.accuracy)
    assert line.startswith("accuracy default: ") and "Estimated, coarse: about " in line and "tight: about " in line
    assert " ".join(line.split()) in " ".join(summary(told).split())
    assert line in first_screen(told)
    effects = result["accuracy"]["effects_s"]
    assert max(effects, key=effects.get) == "contact_ageing" and "contact_ageing " in line
    assert 0.0 < sum(effects.values()) < result["accuracy"]["equations_s"] < result["accuracy"]["levels"][1]["seconds"]
    assert accuracy_text(None) == ""
