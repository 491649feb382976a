"""Records made so that one number of the quality gate has a value that is known: a bit beyond its threshold, or not."""

import numpy as np

from data_io import Record
from identify.logs.judgement import RecordPart
from identify.logs.segment import segment

N = 4000
RATE = 500.0
TIME = np.arange(N) / RATE


def noise(seed, n=N, sd=1e-3):
    return sd * np.random.default_rng(seed).standard_normal(n)


def saw(time, period=0.4, share=0.1, drop=0.2):
    """Sticks and slips: a straight rise, and half a cosine down in `share` of the period; from 0 to `drop`."""
    phase = (time / period) % 1.0
    rise = phase / (1 - share)
    fall = 0.5 * (1 + np.cos(np.pi * (phase - (1 - share)) / share))
    return drop * np.where(phase < 1 - share, rise, fall)


def made(friction=None, normal=None, time=TIME, slope=None, **columns):
    """A record and its part, as the gate takes them; `slope`: what stiffness times drive speed would be [N/s]."""
    friction = 0.4 + saw(time) + noise(1, time.size) if friction is None else friction
    normal = 1.0 + noise(2, time.size) if normal is None else normal
    record = Record(time, normal, friction, **columns)
    return record, [RecordPart(time, friction, segment(time, friction), slope)]


FORCE, COEFFICIENT = made()[0].friction_force, made()[0].friction_force / made()[0].normal_force


def put(values, rows, value):
    """A copy with a value in these rows."""
    out = values.copy()
    out[rows] = value
    return out


def lost(x):
    return made(time=TIME[np.arange(N) % round(1 / x) != round(1 / x) - 1])


def jitter(x):
    # a robust standard deviation of x is a uniform spread of x / 0.7413 to either side
    spread = np.random.default_rng(3).uniform(-x / 0.7413, x / 0.7413, N - 1)
    return made(time=np.r_[0.0, np.cumsum((1 + spread) / RATE)])


def repeated_rows(x):
    record, taken = made()[0], np.arange(N)
    # every row that is to repeat the one before it, each on its own
    for row in np.sort(np.random.default_rng(4).permutation(np.arange(1, N))[: int(x * N)]):
        taken[row] = taken[row - 1]
    return made(record.friction_force[taken], record.normal_force[taken])


def quantisation(x):
    return made(0.2 * x * np.round((0.4 + saw(TIME)) / (0.2 * x)))


def load_ripple(x):
    return made(normal=1.0 + np.sqrt(2) * x * np.sin(2 * np.pi * 5 * TIME))


def clipped_share(x):
    force = 0.4 + saw(TIME, period=1.0) + noise(1)
    return made(np.minimum(force, np.quantile(force, 1 - x)))


def stopped(rows):
    moved = 1e-3 * np.minimum(TIME, TIME[-int(rows)])
    return made(channels={"Drive position": moved}, channel_units={"Drive position": "m"})


def residual_force(x):
    return made(np.where(TIME < 1.0, 0.5 * x, 0.4 + saw(TIME - 1.0)) + noise(1))


def friction_drift(x):  # the first and the last third differ by x
    return made((0.4 + saw(TIME)) * np.where(TIME[-1] / 2 > TIME, 1.0, 1.0 + x) + noise(1))


def load_drift(x):
    return made(normal=1.0 + x / 0.9 * np.linspace(-0.5, 0.5, N) + noise(2))


def rate_switch(factor):
    steps = np.where(np.arange(N - 1) < N // 2, 1.0, 1.0 / factor)
    return made(time=np.r_[0.0, np.cumsum(steps / RATE)])


def ratio(x):
    return made(FORCE * x / np.quantile(COEFFICIENT, 0.9), np.ones(N))


def spikes(x):
    return made(put(FORCE, rows := np.linspace(20, N - 20, round(x * N)).astype(int), FORCE[rows] + 0.5))


def samples_per_slip(count):  # from the last sample of the rise to the first of the next one
    time = np.arange(N) * 0.04 / count
    return made(0.4 + saw(time) + noise(1), time=time)


def samples_per_swing(count):
    return made(0.4 + 0.1 * np.sin(2 * np.pi * np.arange(N) / count + 0.3) + noise(1))


# threshold: how its record is made, a value beyond it and one that is not, the code of the finding, and, where the log
# is rejected beyond ten times the threshold, a value beyond that and one that is not
CASES = {
    "residual_force": (residual_force, 0.06, 0.04, "residual_force"),
    "friction_drift": (friction_drift, 0.12, 0.08, "friction_drift"),
    "load_drift": (load_drift, 0.11, 0.09, "load_drift"),
    "load_ripple": (load_ripple, 0.033, 0.027, "load_ripple", 0.32, 0.28),
    "clipped_rows": (clipped_share, 0.03, 0.004, "friction_clipped", 0.06, 0.04),
    "quantisation": (quantisation, 0.021, 0.019, "friction_coarse", 0.25, 0.125),
    "missing_rows": (lost, 1 / 40, 1 / 60, "dropouts", 1 / 4, 1 / 6),
    "jitter": (jitter, 0.033, 0.027, "jitter", 0.32, 0.28),
    "repeated_rows": (repeated_rows, 0.065, 0.055, "repeated_rows", 0.65, 0.55),
    "spikes": (spikes, 0.0025, 0.0015, "spikes", 0.023, 0.017),
    "cycles": (lambda count: made(time=TIME[: int((count + 0.5) * 0.4 * RATE)]), 2, 3, "few_cycles"),
    "samples_per_slip": (samples_per_slip, 9, 12, "samples_per_slip"),
    "stick_slope": (lambda x: made(slope=0.2 / (0.9 * 0.4) / (1 + x)), 0.11, 0.09, "stick_slope"),
}
