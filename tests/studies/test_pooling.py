"""Pooling against outside answers: the exact analysis of variance, published meta-analyses, Tukey, brute force."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.stats import studentized_range

from experiments.pooling_draws import Plan, draw
from identify.studies.joint import Together, outliers
from identify.studies.mixed import (
    RUN,
    SUBJECT,
    SUBJECT_BY_GROUP,
    Component,
    PoolingError,
    Setting,
    design,
    fit_mixed,
    indicators,
)
from identify.studies.pooled import DIFFERENT, NOT_TESTED, NOT_TOLD_APART, below, critical, pool, predictive


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
    people, crossed, run = mean_squares(y, 8, 3, 3)
    assert crossed > run and people > crossed
    theta = {c.name: t for c, t in zip(found.mixed.components, found.mixed.theta, strict=True)}
    assert theta[RUN] == pytest.approx(run, rel=1e-5)
    assert theta[SUBJECT] == pytest.approx((people - crossed) / 9, rel=1e-5)
    assert theta[SUBJECT_BY_GROUP] == pytest.approx((crossed - run) / 3, rel=1e-5)
    for d in found.differences:
        assert d.error == pytest.approx(np.sqrt(2 * crossed / 24), rel=1e-5)
        assert d.df == pytest.approx(14, rel=1e-5)
        half = studentized_range.ppf(0.95, 3, 14) / np.sqrt(2) * d.error
        assert (d.interval[1] - d.interval[0]) / 2 == pytest.approx(half, rel=1e-3)
        assert sum(d.interval) / 2 == pytest.approx(d.value, rel=1e-9)
    a, b = people / 72, 2 * crossed / 72
    for mean in found.means:
        assert mean.error == pytest.approx(np.sqrt(a + b), rel=1e-5)
        assert mean.df == pytest.approx((a + b) ** 2 / (a * a / 7 + b * b / 14), rel=1e-5)


def test_a_component_of_zero_keeps_its_degrees_of_freedom():
    """Two people and fifteen runs have one degree of freedom, also where the draw shows no scatter between people."""
    for seed in range(40):
        y, setting = balanced(seed, people=2, groups=2, runs=15, crossed=0.0)
        found = pool(y, np.zeros(len(y)), setting)
        if found.mixed.variance_of(SUBJECT_BY_GROUP) == 0.0:
            assert found.differences[0].df == pytest.approx(1.0, rel=1e-4)
            return
    pytest.fail("no draw put the component at zero")


def test_a_published_meta_analysis():
    """The BCG vaccine trials as in metafor's dat.bcg: rma(yi, vi, method="REML") prints these."""
    treated = np.array([4, 6, 3, 62, 33, 180, 8, 505, 29, 17, 186, 5, 27])
    others = np.array([119, 300, 228, 13536, 5036, 1361, 2537, 87886, 7470, 1699, 50448, 2493, 16886])
    control = np.array([11, 29, 11, 248, 47, 372, 10, 499, 45, 65, 141, 3, 29])
    healthy = np.array([128, 274, 209, 12619, 5761, 1079, 619, 87892, 7232, 1600, 27197, 2338, 17825])
    n, m = treated + others, control + healthy
    y, noise = np.log(treated / n / (control / m)), 1 / treated - 1 / n + 1 / control - 1 / m
    found = fit_mixed(y, np.ones((13, 1)), noise, [Component(RUN, np.eye(13))])
    assert found.beta[0] == pytest.approx(-0.7145, abs=5e-5)
    assert np.sqrt(found.plain[0, 0]) == pytest.approx(0.1798, abs=5e-5)
    assert found.theta[0] == pytest.approx(0.3132, abs=5e-5)
    assert np.sqrt(found.theta_covariance[0, 0]) == pytest.approx(0.1664, abs=5e-5)


def test_unbalanced_designs_reach_the_top_of_the_restricted_likelihood():
    study = draw(Plan("lost", volunteers=6, runs=3, lost=0.4), np.random.default_rng(5))
    plan, y, noise = design(study.setting), study.y[:, 0], study.noise[:, 0, 0]
    found = fit_mixed(y, plan.X, noise, plan.components)

    def cost(log_theta):
        V = np.diag(noise) + sum(np.exp(t) * c.Z @ c.Z.T for t, c in zip(log_theta, plan.components, strict=True))
        inverse = np.linalg.inv(V)
        inner = plan.X.T @ inverse @ plan.X
        rest = y - plan.X @ np.linalg.solve(inner, plan.X.T @ inverse @ y)
        return 0.5 * (np.linalg.slogdet(V)[1] + np.linalg.slogdet(inner)[1] + rest @ inverse @ rest)

    best = minimize(
        cost, np.log(np.array([4e-4, 4e-3, 1e-3])), method="Nelder-Mead", options={"xatol": 1e-7, "fatol": 1e-12}
    )
    assert found.likelihood == pytest.approx(-best.fun, abs=1e-6)
    np.testing.assert_allclose(found.theta, np.exp(best.x), rtol=2e-3)


@pytest.mark.parametrize(("groups", "df"), [(3, 2.0), (3, 14.0), (4, 10.0), (6, 30.0)])
def test_all_pairs_are_tukeys_studentised_range(groups, df):
    L = np.array([np.eye(groups)[i] - np.eye(groups)[j] for i in range(groups) for j in range(i + 1, groups)])
    q = critical(L @ L.T, df, 0.95)
    assert q == pytest.approx(studentized_range.ppf(0.95, groups, df) / np.sqrt(2), rel=2e-3)
    assert below(q, L @ L.T, df) == pytest.approx(0.95, abs=1e-4)


def test_thirty_logs_of_one_person_are_one_person():
    random = np.random.default_rng(2)
    y = np.r_[0.5 + 0.01 * random.standard_normal(30), 0.7 + 0.01 * random.standard_normal(30)]
    groups = ("A",) * 30 + ("B",) * 30
    one = pool(y, np.full(60, 1e-6), Setting(groups, ("V1",) * 60))
    assert one.differences[0].verdict == NOT_TESTED
    assert "one subject only with A" in one.differences[0].reason
    assert one.means[0].interval is None
    # the negative control: if nobody says whose they are, the same numbers are called different
    assert pool(y, np.full(60, 1e-6), Setting(groups)).differences[0].verdict == DIFFERENT


def test_more_logs_of_the_same_people_do_not_shrink_the_interval():
    def width(runs, subject):
        y, setting = balanced(4, people=5, groups=2, runs=runs, crossed=0.05)
        found = pool(y, np.zeros(len(y)), setting if subject else Setting(setting.group))
        return np.diff(found.means[0].interval)[0]

    assert width(40, True) > 0.7 * width(4, True)
    assert width(40, False) < 0.5 * width(4, False)


def test_what_fits_tell_badly_counts_little():
    y = np.array([1.0, 1.02, 0.98, 5.0, 2.0, 2.02, 1.98])
    noise = np.array([1e-4] * 3 + [25.0] + [1e-4] * 3)
    found = pool(y, noise, Setting(("A",) * 4 + ("B",) * 3))
    assert found.means[0].value == pytest.approx(1.0, abs=0.01)
    assert abs(np.mean(y[:4]) - 1.0) > 0.9  # what a mean of point values would say


def test_a_covariate_is_taken_out_and_what_goes_with_the_groups_is_named():
    random = np.random.default_rng(8)
    moist = random.normal(40.0, 8.0, 40)
    group = np.where(random.random(40) < 1 / (1 + np.exp(-(moist - 40) / 4)), "B", "A")
    y = 0.5 + 0.01 * (moist - 40.0) + 0.005 * random.standard_normal(40)
    subject = tuple(f"V{k}" for k in range(40))
    plain = pool(y, np.zeros(40), Setting(tuple(group), subject))
    adjusted = pool(y, np.zeros(40), Setting(tuple(group), subject, covariates={"hydration": tuple(moist)}))
    assert plain.differences[0].verdict == DIFFERENT
    assert adjusted.differences[0].verdict == NOT_TOLD_APART
    place = adjusted.design.columns.index("hydration")
    assert adjusted.mixed.beta[place] == pytest.approx(0.01, abs=6e-4)
    mixed_up = Setting(tuple(group), subject, covariates={"batch": tuple((group == "B").astype(float))})
    assert "batch" in pool(y, np.zeros(40), mixed_up).design.dropped


def test_own_volunteers_for_each_material_are_told_from_the_same_ones():
    random = np.random.default_rng(3)
    people = 0.1 * random.standard_normal(8)
    y = np.concatenate([people + 0.50, people + 0.56]) + 0.003 * random.standard_normal(16)
    groups = ("A",) * 8 + ("B",) * 8
    same = pool(y, np.zeros(16), Setting(groups, tuple(f"V{k % 8}" for k in range(16))))
    own = pool(y, np.zeros(16), Setting(groups, tuple(f"V{k}" for k in range(16))))
    assert same.differences[0].shared == 8 and same.differences[0].verdict == DIFFERENT
    assert own.differences[0].shared == 0 and own.differences[0].verdict == NOT_TOLD_APART


def test_the_answer_does_not_hang_on_order_or_unit():
    study = draw(Plan("few", volunteers=4, runs=2, lost=0.2), np.random.default_rng(6))
    y, noise = study.y[:, 0], study.noise[:, 0, 0]
    first = pool(y, noise, study.setting)
    order = np.random.default_rng(1).permutation(len(y))
    second = pool(1000 * y[order], 1e6 * noise[order], study.setting.rows(order.tolist()))
    other = {m.group: m for m in second.means}
    for mean in first.means:
        assert other[mean.group].value == pytest.approx(1000 * mean.value, rel=1e-6)
        assert other[mean.group].error == pytest.approx(1000 * mean.error, rel=1e-4)


def test_an_odd_fit_is_flagged_and_an_even_study_flags_nobody():
    study = draw(Plan("odd"), np.random.default_rng(12))
    y, noise = study.y[:, 0].copy(), study.noise[:, 0, 0]
    assert outliers(pool(y, noise, study.setting).mixed) == ()
    y[17] += 0.25
    (found,) = outliers(pool(y, noise, study.setting).mixed)
    assert found.row == 17 and found.z > 4


def test_quantities_hang_together_as_they_were_drawn():
    study = draw(Plan("many", volunteers=40, runs=2), np.random.default_rng(9))
    pooled = [pool(study.y[:, k], study.noise[:, k, k], study.setting) for k in range(6)]
    joint = Together(pooled, study.setting, study.noise).group("M2")
    R = joint.scatter / np.sqrt(np.outer(np.diag(joint.scatter), np.diag(joint.scatter)))
    assert R[0, 1] == pytest.approx(0.8, abs=0.1)
    assert R[4, 5] == pytest.approx(0.5, abs=0.2)
    assert abs(R[0, 3]) < 0.3
    assert np.min(np.linalg.eigvalsh(joint.covariance)) > -1e-12
    # the difference of two logarithms, pooled on its own, has the same standard error
    c = np.array([0.0, 0.0, 0.0, 0.0, 1.0, -1.0])
    alone = pool(study.y @ c, np.einsum("i,nij,j->n", c, study.noise, c), study.setting)
    assert np.sqrt(c @ joint.covariance @ c) == pytest.approx(alone.means[1].error, rel=0.05)
    assert c @ joint.mean == pytest.approx(alone.means[1].value, abs=0.2 * alone.means[1].error)


def test_one_more_person_scatters_as_people_do():
    y, setting = balanced(1)
    people, crossed, run = mean_squares(y, 8, 3, 3)
    value, sd, df = predictive(pool(y, np.zeros(len(y)), setting), "M0")
    mean = (people + 2 * crossed) / 72
    spread = (people - crossed) / 9 + (crossed - run) / 3 + run
    assert value == pytest.approx(np.mean(y[np.array(setting.group) == "M0"]))
    assert sd == pytest.approx(np.sqrt(mean + spread), rel=1e-5)
    assert 7 < df < 20


def test_many_groups_have_means_but_no_pairs():
    y, setting = np.random.default_rng(0).standard_normal(80), Setting(tuple(f"g{k % 40}" for k in range(80)))
    found = pool(y, np.zeros(80), setting)
    assert len(found.means) == 40 and found.differences == ()


def test_too_few_fits_are_refused_in_one_sentence():
    with pytest.raises(PoolingError, match="2 fits for 2 means"):
        pool(np.array([1.0, 2.0]), np.zeros(2), Setting(("A", "B")))
    assert indicators(["b", "a", "b"]).tolist() == [[1.0, 0.0], [0.0, 1.0], [1.0, 0.0]]


def test_steps_do_not_swing_about_the_top():
    """Where observed and expected information differ twofold, plain Fisher scoring swings for hundreds of steps."""
    random = np.random.default_rng(103)
    plan = Plan("paired, 4 volunteers, 2 runs", volunteers=4, runs=2)
    for _ in range(26):
        study = draw(plan, random)
    found = pool(study.y[:, 4], study.noise[:, 4, 4], study.setting)
    slope = [
        0.5 * (y @ c.Z @ c.Z.T @ y - np.trace(found.mixed.projection @ c.Z @ c.Z.T))
        for c in found.design.components
        for y in [found.mixed.projection @ found.mixed.y]
    ]
    assert np.all(np.abs(slope * found.mixed.theta) < 1e-3)


@pytest.mark.parametrize("run", [1e-3, 1e-4])
def test_two_people_far_apart_and_runs_close_together(run):
    """People 0.08 apart whose runs repeat to a thousandth: the scatter of people is that of the analysis of variance,
    not whatever the first long step reached; control: people three times as far apart scatter three times as much."""
    setting = Setting(tuple(f"M{k}" for k in (0, 0, 0, 0, 1, 1, 1, 1)), ("V0", "V1") * 4)
    level = np.array([0.62, 0.70] * 4) + run * np.array([-1.0, 0.5, 0.8, -0.6, 0.3, 0.9, -0.7, -0.4])

    def scatter(y):
        found = pool(y, np.full(8, (0.5 * run) ** 2), setting)
        assert found.differences[0].verdict == NOT_TOLD_APART and found.means[0].df == pytest.approx(1.0, rel=0.01)
        return np.sqrt(found.mixed.variance_of(SUBJECT))

    apart = abs(level[1::2].mean() - level[::2].mean())
    assert scatter(level) == pytest.approx(apart / np.sqrt(2), rel=1e-3)
    assert scatter(level + np.array([0.0, 0.16] * 4)) == pytest.approx((apart + 0.16) / np.sqrt(2), rel=1e-3)
