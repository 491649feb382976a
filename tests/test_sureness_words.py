"""What is said of intervals from draws beside those from straight lines."""

from __future__ import annotations

import pytest

from identify.prediction.chance import Certainty, Chance
from identify.prediction.sureness import _text

SURE = Chance(0.999, 1.0, (0.99, 1.0))


@pytest.mark.parametrize(("drawn", "said"), [(0.1232, False), (0.13, True)])
def test_ends_that_print_alike_are_not_set_against_each_other(drawn: float, said: bool) -> None:
    row = {"unit": "s", "linear": [0.12301, 0.12302], "interval": [0.12303, drawn], "alike": False}
    text = _text("1 mm/s and 1 N", Certainty(SURE, SURE, {}, 400, 0), {"quantities": {"period": row}})
    assert ("take the draws" in text) is said
    assert text.startswith("Probability of stick-slip at 1 mm/s and 1 N: above 99 %")
