"""What is said of intervals from draws beside those from straight lines."""

from __future__ import annotations

import pytest

from identify.prediction.probability import ComparedInterval, Probability, StickSlipProbability, _text

SURE = Probability(1.0, "", (0.99, 1.0), linear=0.999)


@pytest.mark.parametrize("alike", [True, False])
def test_only_the_draws_of_a_skew_answer_are_said(alike: bool) -> None:
    row = ComparedInterval(0.125, "s", (0.12301, 0.12302) if alike else None, (0.123, 0.13), alike)
    text = _text("1 mm/s and 1 N", StickSlipProbability(SURE, SURE, {}, 400, 0), {"period": row})
    assert ("95 % of the draws of the period lie from 0.123 s to 0.13 s" in text) is not alike
    assert ("straight lines agree" in text) is alike
    assert text.startswith("Probability of stick-slip at 1 mm/s and 1 N: above 99 %")
