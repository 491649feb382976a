"""A role that a column got by its name alone is asked for where another column does the job; else nothing is asked."""

from pathlib import Path

import numpy as np
import pytest

from data_io import LogError, read_log

CASES = Path(__file__).parents[1] / "cases"
N = 600
TIME = np.arange(N) / 100.0


def saw(high=0.9, low=0.5):
    """A force of stick-slip [N]."""
    return low + (high - low) * (TIME % 0.8) / 0.8 + np.random.default_rng(1).normal(0.0, 1e-3, N)


def still(level, sd=2e-3, seed=2):
    return level + np.random.default_rng(seed).normal(0.0, sd, N)


def text(folder, delimiter=",", **columns):
    rows = [delimiter.join(columns)]
    rows += [delimiter.join(f"{values[i]:.5f}" for values in columns.values()) for i in range(N)]
    (folder / "a.txt").write_text("\n".join(rows) + "\n")
    return folder / "a.txt"


def test_the_force_of_six_axes_is_asked_for():
    with pytest.raises(LogError, match=r"'Fx \(N\)'.*stands still.*'Fy \(N\)' moves.*friction_force=Fy"):
        read_log(CASES / "six_axis_off.csv")
    record = read_log(CASES / "six_axis_off.csv", columns={"friction_force": "Fy"})
    assert np.mean(record.friction_force / record.normal_force) == pytest.approx(0.475, abs=2e-3)
    assert len(read_log(CASES / "six_axis_off.csv", columns={"friction_force": "Fx"})) == 800


def test_swapped_forces_are_asked_for(tmp_path):
    path = text(tmp_path, **{"t [s]": TIME, "Fx [N]": still(2.0), "Fz [N]": saw()})
    with pytest.raises(LogError, match=r"may be swapped.*friction_force=Fz,normal_force=Fx"):
        read_log(path)
    turned = read_log(path, columns={"friction_force": "Fz", "normal_force": "Fx"})
    assert np.median(turned.normal_force) == pytest.approx(2.0, abs=0.01)


@pytest.mark.parametrize(
    ("friction", "other"),
    [
        (saw(), still(0.05)),  # as it should be
        (still(0.5), still(0.05)),  # steady sliding: nothing moves
        (still(0.5), 0.01 * TIME),  # the other one drifts, and holds no friction
        (saw(), saw(9.0, 5.0)),  # both move: the name decides
    ],
)
def test_what_is_as_its_name_says_is_not_asked_for(tmp_path, friction, other):
    path = text(tmp_path, **{"t [s]": TIME, "Fx [N]": friction, "Fy [N]": other, "Fz [N]": still(1.0)})
    np.testing.assert_allclose(read_log(path).friction_force, friction, atol=1e-5)


def test_a_load_that_swings_under_a_high_friction_is_not_asked_for(tmp_path):
    path = text(tmp_path, **{"t [s]": TIME, "Fx [N]": saw(1.8, 1.2), "Fz [N]": 1.0 + 0.1 * np.sin(TIME)})
    assert len(read_log(path)) == N
