"""Three materials, eight volunteers, uneven friction: the order by strength, and false differences, after pooling.

200 times 24 whole fits are too dear, so the strength of every volunteer on every material is drawn with the error that
the estimator has on simulated records (docs/validation.md, Simulated uneven records): its bias, and a scatter that the
stated deviation understates. So this tests the pooling, not the estimator. Strengths are 0.03, 0.045 and 0.06, or one.

    python experiments/run_uneven_materials.py [studies]
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from identify.studies.mixed import Setting
from identify.studies.pooled import DIFFERENT, Pooled, pool

STRENGTHS, SAME = np.log([0.030, 0.045, 0.060]), np.log([0.045, 0.045, 0.045])
VOLUNTEERS = 8
PEOPLE, CROSSED = 0.20, 0.15  # sd of the logarithm: between people, and of a person on one material
STATED = (0.06, 0.12)  # of the logarithm, between which the stated deviations of a fit lie
BIAS, UNDERSTATED = 0.05, 1.3  # of the logarithm; factor of the true deviation over the stated one


def study(truth: np.ndarray, random: np.random.Generator) -> Pooled:
    """The pooled strengths of one study; every volunteer tries every material once."""
    people = PEOPLE * random.standard_normal(VOLUNTEERS)
    own = truth[:, None] + people + CROSSED * random.standard_normal((truth.size, VOLUNTEERS))
    stated = random.uniform(*STATED, own.shape)
    found = own + BIAS + UNDERSTATED * stated * random.standard_normal(own.shape)
    groups = tuple(f"M{m + 1}" for m in range(truth.size) for _ in range(VOLUNTEERS))
    subjects = tuple(f"V{v + 1}" for _ in truth for v in range(VOLUNTEERS))
    return pool(found.ravel(), stated.ravel() ** 2, Setting(groups, subjects))


def main(fast: bool = False, studies: int = 200) -> tuple[int, int, int]:
    """Studies in the right order, studies that claim a difference where there is none, and studies of each kind."""
    many = 8 if fast else studies
    random = np.random.default_rng(1)
    right = false = 0
    for _ in range(many):
        means = [m.value for m in sorted(study(STRENGTHS, random).means, key=lambda m: m.group)]
        right += means == sorted(means)
        false += any(d.verdict == DIFFERENT for d in study(SAME, random).differences)
    print(f"order by strength right in {right} of {many} studies; a false difference in {false} of {many}")
    return right, false, many


if __name__ == "__main__":
    main(studies=int(sys.argv[1]) if len(sys.argv) > 1 else 200)
