"""Pooling against outside answers: the textbook's analysis of variance, scipy's tests, draws without differences."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from experiments.pooling_draws import Plan, draw
from identify.studies.pooled import DIFFERENT, NOT_TESTED, PoolingError, Setting, pool


def balanced(seed, people=8, groups=3, runs=3, crossed=0.03):
    random = np.random.default_rng(seed)
    v, m, _ = (a.ravel() for a in np.meshgrid(range(people), range(groups), range(runs), indexing="ij"))
    y = np.array([0.5, 0.55, 0.62, 0.7])[m] + 0.06 * random.standard_normal(people)[v]
    y = y + crossed * random.standard_normal((people, groups))[v, m] + 0.02 * random.standard_normal(len(v))
    return y, Setting(tuple(f"M{k}" for k in m), tuple(f"V{k}" for k in v))


def mean_squares(y, people, groups, runs):
    """Mean squares of people, people by groups, and runs, after the textbook."""
    table = y.reshape(people, groups, runs)
    cell = table.mean(2)
    rest = cell - cell.mean(0) - cell.mean(1)[:, None] + cell.mean()
    return (
        runs * groups * np.sum((cell.mean(1) - cell.mean()) ** 2) / (people - 1),
        runs * np.sum(rest**2) / ((people - 1) * (groups - 1)),
        np.sum((table - cell[..., None]) ** 2) / (people * groups * (runs - 1)),
    )


def test_balanced_designs_give_the_exact_analysis_of_variance():
    y, setting = balanced(1)
    found = pool(y, np.zeros(len(y)), setting)
    _, crossed, run = mean_squares(y, 8, 3, 3)
    assert found.scatter.run == pytest.approx(math.sqrt(run), rel=1e-12)
    for d in found.differences:
        assert d.error == pytest.approx(math.sqrt(2 * crossed / 24), rel=1e-9)
        assert d.df == 14
        half = stats.studentized_range.ppf(0.95, 3, 14) / math.sqrt(2) * d.error
        assert (d.interval[1] - d.interval[0]) / 2 == pytest.approx(half, rel=1e-6)
        assert sum(d.interval) / 2 == pytest.approx(d.value, rel=1e-9)
    people = y.reshape(8, 3, 3).mean(2)
    for k, mean in enumerate(found.means):
        expected = stats.ttest_1samp(people[:, k], 0.0).confidence_interval(0.95)
        assert mean.interval == pytest.approx((expected.low, expected.high), rel=1e-9)


@pytest.mark.parametrize("seed", range(3))
def test_people_of_each_group_are_compared_as_tukey_does(seed):
    random = np.random.default_rng(seed)
    samples = [random.normal(level, 0.05, n) for level, n in ((0.5, 4), (0.58, 6), (0.6, 5))]
    group = tuple(f"M{k}" for k, sample in enumerate(samples) for _ in sample)
    y = np.concatenate(samples)
    found = pool(y, np.zeros(len(y)), Setting(group, tuple(f"V{k}" for k in range(len(y)))))
    expected = stats.tukey_hsd(*samples)
    ends = expected.confidence_interval(0.95)
    for d in found.differences:
        i, j = int(d.first[1]), int(d.second[1])
        assert d.p == pytest.approx(expected.pvalue[i, j], rel=5e-3)
        assert d.interval == pytest.approx((ends.low[i, j], ends.high[i, j]), rel=1e-6)


@pytest.mark.parametrize("scatter", [0.05, 0.15])
def test_two_groups_are_compared_as_student_does_in_pairs_and_else_as_welch_does(scatter):
    random = np.random.default_rng(4)
    first, second = random.normal(0.5, 0.05, 6), random.normal(0.56, scatter, 6)
    groups, y = ("A",) * 6 + ("B",) * 6, np.concatenate([first, second])
    paired, free = stats.ttest_rel(first, second), stats.ttest_ind(first, second, equal_var=False)
    for people, shared, expected in (([k % 6 for k in range(12)], 6, paired), (range(12), 0, free)):
        found = pool(y, np.zeros(12), Setting(groups, tuple(f"V{k}" for k in people))).differences[0]
        assert found.p == pytest.approx(expected.pvalue, rel=1e-9) and found.shared == shared
        assert found.interval == pytest.approx(tuple(expected.confidence_interval(0.95)), rel=1e-9)


NULL = (
    Plan("paired", volunteers=5, runs=2),
    Plan("two of own people", materials=2, volunteers=5, runs=2, paired=False),
    Plan("runs lost", volunteers=6, runs=2, lost=0.33),
)


@pytest.mark.parametrize("plan", NULL, ids=lambda plan: plan.name)
def test_false_differences_are_at_most_five_percent(plan):
    """200 studies without a difference, at 5 % exceeded once in fifty times. Control: every fit as a person of its
    own."""
    random, false, naive = np.random.default_rng(11), 0, 0
    for _ in range(200):
        study = draw(plan, random)
        y, noise = study.y[:, 0], study.noise[:, 0, 0]
        false += any(d.verdict == DIFFERENT for d in pool(y, noise, study.setting).differences)
        if not plan.paired:
            naive += any(d.verdict == DIFFERENT for d in pool(y, noise, Setting(study.setting.group)).differences)
    assert false <= stats.binom.ppf(0.98, 200, 0.05)
    assert plan.paired or naive > 20


def test_intervals_of_means_cover():
    random, hits = np.random.default_rng(3), []
    for _ in range(200):
        study = draw(Plan("paired", volunteers=5, runs=2), random)
        for mean in pool(study.y[:, 0], study.noise[:, 0, 0], study.setting).means:
            low, high = mean.interval
            hits.append(low <= study.truth[int(mean.group[1]) - 1, 0] <= high)
    assert 0.92 <= np.mean(hits) <= 0.98


def test_thirty_logs_of_one_person_are_one_person():
    random = np.random.default_rng(2)
    y = np.r_[0.5 + 0.01 * random.standard_normal(30), 0.7 + 0.01 * random.standard_normal(30)]
    groups = ("A",) * 30 + ("B",) * 30
    with pytest.raises(PoolingError, match="no group has fits of two people"):
        pool(y, np.full(60, 1e-6), Setting(groups, ("V1",) * 60))
    # one person with A, two with B: A is not tested
    one = pool(y, np.full(60, 1e-6), Setting(groups, ("V1",) * 45 + ("V2",) * 15))
    assert one.differences[0].verdict == NOT_TESTED
    assert "one subject only with A" in one.differences[0].reason
    assert one.means[0].interval is None
    # the negative control: if nobody says whose they are, the same numbers are called different
    assert pool(y, np.full(60, 1e-6), Setting(groups)).differences[0].verdict == DIFFERENT


def test_groups_that_no_people_join_are_not_tested():
    random = np.random.default_rng(0)
    pairs = [(g, v) for g in "AB" for v in "123"] + [(g, v) for g in "CD" for v in "456"]
    setting = Setting(tuple(g for g, _ in pairs), tuple(v for _, v in pairs))
    found = {(d.first, d.second): d for d in pool(random.standard_normal(12), np.zeros(12), setting).differences}
    assert found["A", "B"].verdict != NOT_TESTED and found["C", "D"].verdict != NOT_TESTED
    assert found["A", "C"].reason == "no people join these two groups"


def test_the_answer_does_not_hang_on_order_or_unit():
    study = draw(Plan("few", volunteers=4, runs=2, lost=0.2), np.random.default_rng(6))
    y, noise = study.y[:, 0], study.noise[:, 0, 0]
    first = pool(y, noise, study.setting)
    order = np.random.default_rng(1).permutation(len(y))
    second = pool(1000 * y[order], 1e6 * noise[order], study.setting.rows(order.tolist()))
    for mean in first.means:
        other = second.mean_of(mean.group)
        assert (other.value, other.error) == pytest.approx((1000 * mean.value, 1000 * mean.error), rel=1e-9)
    widths = [sorted(d.error for d in found.differences) for found in (first, second)]
    assert widths[1] == pytest.approx([1000 * error for error in widths[0]], rel=1e-9)


def test_too_many_groups_have_means_but_no_pairs_and_too_few_fits_are_refused():
    y, setting = np.random.default_rng(0).standard_normal(80), Setting(tuple(f"g{k % 40}" for k in range(80)))
    found = pool(y, np.zeros(80), setting)
    assert len(found.means) == 40 and found.differences == ()
    with pytest.raises(PoolingError, match="no group has two fits"):
        pool(np.array([1.0, 2.0]), np.zeros(2), Setting(("A", "B")))
