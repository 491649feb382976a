"""A made-up Fit for tests of the report: one slip integrated with plain numpy steps, repeated with known scatter."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from identify.base.outcome import LogCurves, SlipDetail
from identify.report.finished import Fit
from identify.scene import Scene

MASS, STIFFNESS, DAMPING, LOAD, NOISE = 0.2, 1470.0, 147.0, 1.0, 0.005
MU_S, MU_K0, DELTA, A, LENGTH, CREEP = 0.62, 0.43, -0.13, 300.0, 37.4e-6, 0.5
SPEEDS = (0.1 / 6e4, 1e-4, 1e-3, 5e-3)
PARAMETERS = (
    ("mu_s", 0.62, 0.0011, "", "identified", ""),
    ("mu_k0", 0.43, 0.0009, "", "identified", ""),
    ("delta_mu_k", -0.13, 0.0021, "", "identified", ""),
    ("a", 301.7, 9.3, "s/m", "identified", ""),
    ("D", 37.42e-6, 0.21e-6, "m", "identified", ""),
    ("t_cr", 0.5013, 0.0042, "s", "identified", ""),
)
TRUTH = {name: value for name, value, *_ in PARAMETERS}
EFFECTS = ["inertia", "hysteresis_damping", "contact_ageing", "velocity_weakening"]
RIG = {"mass": "0.2 kg", "stiffness": "1.47 N/mm", "zeta": 0.05, "normal_force": "1 N"}
Array = NDArray[np.float64]


def one_slip(speed: float, step: float = 4e-5) -> dict[str, Array]:
    """One slip from rest at the onset force, by small Heun steps: time from onset and the states, each shape (m,)."""
    damper = DAMPING / np.sqrt(STIFFNESS / MASS)

    def rates(state: Array) -> Array:
        elongation, v, gamma = state
        kinetic = MU_K0 + DELTA * (1 - np.exp(-A * max(v, 0.0)))
        friction = LOAD * (kinetic + (MU_S - kinetic) * gamma)
        push = STIFFNESS * elongation + damper * (speed - v)
        return np.array([speed - v, (push - friction) / MASS, (1 - gamma) / CREEP - v / LENGTH])

    rest = 1 - np.exp(-0.25 / (STIFFNESS * speed * CREEP))
    onset = (MU_K0 + (MU_S - MU_K0) * rest) * LOAD
    states = [np.array([(onset - damper * speed) / STIFFNESS, 1e-7, rest])]
    while states[-1][1] > 0 and len(states) < 4000:
        first = rates(states[-1])
        second = rates(states[-1] + step * first)
        following = states[-1] + step / 2 * (first + second)
        following[2] = min(max(following[2], 0.0), 1.0)
        states.append(following)
    elongation, v, gamma = np.array(states).T
    v = np.maximum(v, 0.0)
    kinetic = MU_K0 + DELTA * (1 - np.exp(-A * v))
    return {
        "time": step * np.arange(len(v)),
        "force": STIFFNESS * elongation + damper * (speed - v),
        "elongation": elongation,
        "sliding_speed": v,
        "gamma": gamma,
        "coefficient": kinetic + (MU_S - kinetic) * gamma,
    }


def log_curves(speed: float, samples: int, cycles: int = 9, scatter: float = 0.0, seed: int = 0) -> LogCurves:
    """A log of so many cycles; `scatter` is the relative standard deviation of the period and of the level."""
    random = np.random.default_rng(seed)
    slip = one_slip(speed)
    fall, length = slip["force"][0] - slip["force"][-1], slip["time"][-1]
    stick = fall / (STIFFNESS * speed)
    factor = 1 + scatter * random.standard_normal(cycles)
    onset = stick * 0.7 + np.concatenate([[0.0], np.cumsum((stick * factor + length)[:-1])])
    end = onset[-1] + length + 0.6 * stick
    time = np.linspace(0, end, samples)
    force = _force(time, onset, slip, speed)
    level = np.interp(time, onset, 1 + 0.3 * (factor - 1))
    measured = force * level + NOISE * random.standard_normal(samples)
    used = np.ones(samples, bool)
    used[: samples // 40] = False
    fitted = np.where(used, force, np.nan)
    table = np.column_stack(
        [
            onset,
            onset + length,
            slip["force"][0] * factor**0.3,
            slip["force"][-1] * factor**0.3,
            random.normal(0, 1.1, cycles),
        ]
    )
    return LogCurves(
        name=f"pair_{speed * 6e4:g}_mm_min.txt",
        time=time,
        normal_force=LOAD * (1 - 0.05 * (1 - np.exp(-3 * time / end))) + 0.002 * random.standard_normal(samples),
        friction_force=measured,
        fitted_force=fitted,
        used=used,
        noise=NOISE,
        drive_speed=speed,
        cycles=table,
        measured=table[:, :4],
        slip=_detail(slip, speed, float(onset[cycles // 2]), cycles // 2 + 1, time),
    )


def fake_fit(samples: int = 8000, logs: int = 4, scatter: float = 0.0) -> Fit:
    """A converged fit of so many logs with so many samples each."""
    curves = tuple(log_curves(SPEEDS[i % 4], samples, scatter=scatter, seed=i) for i in range(logs))
    return Fit(result=_document(curves), logs=curves)


def fit_of_a_scene() -> Fit:
    """The same with a scene that can be simulated: four logs at 1 N, `RIG` and `EFFECTS`."""
    fit = fake_fit(samples=4000)
    logs = [{"path": f"log_{i}.txt", "drive_speed": speed} for i, speed in enumerate(SPEEDS, 1)]
    scene = Scene.from_document({"name": "pair", "effects": EFFECTS, "rig": RIG, "logs": logs}).as_document()
    told = [
        {**log, "drive_speed_m_per_s": speed, "normal_force_N": 1.0}
        for log, speed in zip(fit.result["logs"], SPEEDS, strict=True)
    ]
    return replace(fit, result={**fit.result, "provenance": {**fit.result["provenance"], "scene": scene}, "logs": told})


def with_verdicts(fit: Fit) -> Fit:
    """The same fit with every kind of verdict."""
    told = dict(fit.result["parameters"])
    test = "a log at 5 mm/s sampled at 1 kHz or more would tell"
    told["a"] = {
        **told["a"],
        "standard_error": None,
        "interval": [112.0, None],
        "verdict": "not identifiable",
        "reason": test,
    }
    told["delta_mu_k"] = {**told["delta_mu_k"], "interval": [-0.19, -0.08], "verdict": "weak", "reason": test}
    told["t_cr"] = {
        **told["t_cr"],
        "interval": [None, None],
        "standard_error": None,
        "verdict": "at bound",
        "reason": test,
    }
    told["D"] = {
        **told["D"],
        "interval": None,
        "standard_error": None,
        "verdict": "fixed",
        "reason": "fixed in the scene",
    }
    return replace(fit, result={**fit.result, "parameters": told})


def failed(fit: Fit, status: str, message: str) -> Fit:
    """The same logs with a status other than converged: null parameters, the last iterate apart."""
    last = {name: {"value": entry["value"], "unit": entry["unit"]} for name, entry in fit.result["parameters"].items()}
    null = {
        name: {**entry, "value": None, "standard_error": None, "interval": None}
        for name, entry in fit.result["parameters"].items()
    }
    result = {
        **fit.result,
        "status": status,
        "message": message,
        "parameters": null,
        "last_iterate": last,
        "correlation": None,
    }
    return Fit(result=result, logs=fit.logs)


def without_cycles(fit: Fit) -> Fit:
    """The same logs with nothing detected and nothing fitted."""
    bare = tuple(
        replace(
            log,
            fitted_force=np.full_like(log.time, np.nan),
            cycles=np.empty((0, 5)),
            measured=np.empty((0, 4)),
            slip=None,
        )
        for log in fit.logs
    )
    message = "No log holds three complete stick-slip cycles; drive slower, or press harder, and record again."
    ended = failed(Fit(fit.result, bare), "no_cycles", message)
    return replace(ended, result={**ended.result, "gate": None, "fit": None, "derived": {}, "last_iterate": {}})


def _force(time: Array, onset: Array, slip: dict[str, Array], speed: float) -> Array:
    """Straight sticks between the slips that begin at the onsets."""
    length = slip["time"][-1]
    knots = np.concatenate([[time[0] - 1e-9], *(np.append(at + slip["time"][::20], at + length) for at in onset)])
    waveform = np.append(slip["force"][::20], slip["force"][-1])
    start = slip["force"][0] - STIFFNESS * speed * (onset[0] - time[0])
    levels = np.concatenate([[start], np.tile(waveform, len(onset))])
    after = onset[-1] + length
    tail = slip["force"][-1] + STIFFNESS * speed * (time - after)
    return np.where(time > after, tail, np.interp(time, knots, levels))


def _detail(slip: dict[str, Array], speed: float, onset: float, cycle: int, time: Array) -> SlipDetail:
    """The slip with a little stick on both sides of it."""
    length = slip["time"][-1]
    before, after = np.linspace(-0.2 * length, 0, 40)[:-1], np.linspace(0, 0.35 * length, 60)[1:]
    joined = {
        "time": onset + np.concatenate([before, slip["time"], length + after]),
        "sliding_speed": np.pad(slip["sliding_speed"], (39, 59)),
    }
    for name, slope in (
        ("elongation", speed),
        ("force", STIFFNESS * speed),
        ("gamma", 1 / CREEP),
        ("coefficient", 0.0),
    ):
        ends = slip[name][0] + slope * before, slip[name][-1] + slope * after
        joined[name] = np.concatenate([ends[0], slip[name], ends[1]])
    first, last = np.searchsorted(time, [joined["time"][0], joined["time"][-1]])
    return SlipDetail(cycle=cycle, samples=np.arange(first, last), **joined)


def _document(curves: tuple[LogCurves, ...]) -> dict[str, Any]:
    names = [name for name, *_ in PARAMETERS]
    random = np.random.default_rng(5)
    draw = np.corrcoef(random.standard_normal((6, 9)))
    return {
        "schema": 1,
        "status": "converged",
        "message": f"{len(curves)} logs and {sum(len(log.cycles) for log in curves)} cycles agree within the noise.",
        "parameters": {
            name: {
                "value": value,
                "unit": unit,
                "standard_error": error,
                "interval": [value - 1.96 * error, value + 1.96 * error],
                "level": 0.95,
                "verdict": verdict,
                "reason": reason,
            }
            for name, value, error, unit, verdict, reason in PARAMETERS
        },
        "correlation": {"names": names, "matrix": draw.tolist()},
        "gate": {
            "chi2_per_sample": 1.0021,
            "worst_cycle": {"log": 1, "cycle": 7, "z": 2.9},
            "solver": "Solve_Succeeded",
            "event_shift_samples": 0.08,
            "strength_scatter": None,
        },
        "fit": {"samples": sum(int(log.used.sum()) for log in curves), "cycles": 36, "iterations": 9, "rms_N": NOISE},
        "derived": {
            "v_cr": {"value": 7.48e-5, "unit": "m/s", "interval": [7.3e-5, 7.7e-5], "validity": "D / t_cr"},
            "stick_slip_ends_above": {
                "value": 0.0113,
                "unit": "m/s",
                "interval": [0.0109, 0.0118],
                "validity": "periodic orbit",
            },
        },
        "rig_sensitivity": {
            "mass": {
                "a": {"shift": -31.0, "unit": "s/m", "in_standard_errors": -3.3},
                "D": {"shift": 1e-8, "unit": "m", "in_standard_errors": 0.05},
            },
            "damping": {
                "a": {"shift": 4.1, "unit": "s/m", "in_standard_errors": 0.44},
                "D": {"shift": None, "unit": "m", "in_standard_errors": None},
            },
        },
        "timing_s": {"read": 0.31, "detect": 0.05, "start": 0.16, "build": 0.11, "solve": 0.62, "total": 1.25},
        "notes": ["The noise was estimated from straight lines through the stick phases."],
        "logs": [_log_document(i, log) for i, log in enumerate(curves, start=1)],
        "provenance": {
            "version": "0.1.0",
            "command": "stickslip fit --scene pair.toml",
            "scene": {"name": "UHMWPE on skin, example pair", "effects": ["inertia", "contact_ageing"]},
            "seed": 0,
            "packages": {"numpy": np.__version__, "casadi": "3.8.2"},
        },
    }


def _log_document(position: int, log: LogCurves) -> dict[str, Any]:
    drop = float(np.mean(log.cycles[:, 2] - log.cycles[:, 3]))
    period = float(np.mean(np.diff(log.cycles[:, 0])))
    row = {
        "step": 1,
        "stroke": 1,
        "mean_coefficient": 0.512,
        "mean_coefficient_sd": 0.061,
        "first_breakaway_coefficient": 0.63,
        "static_peak_coefficient": 0.618,
        "kinetic_mean_coefficient": 0.43,
        "drop_N": drop,
        "stick_slope_N_per_s": STIFFNESS * log.drive_speed,
        "stick_stiffness_N_per_m": STIFFNESS,
        "frequency_Hz": 1 / period,
        "stick_slip_percent": 97.0,
        "normal_force_drift_N": -0.05,
    }
    entry = {"value": drop, "unit": "N", "interval": [0.98 * drop, 1.02 * drop]}
    return {
        "path": f"logs/{log.name}",
        "sha256": f"{position:064x}",
        "step": 1,
        "rows": len(log.time),
        "labels": {"material": "UHMWPE", "volunteer": "V07"},
        "noise_N": NOISE,
        "friction_sign": 1,
        "slip_count": len(log.cycles),
        "normal_force_N": LOAD,
        "drive_speed_m_per_s": log.drive_speed,
        "reason_left_out": None,
        "classical": {"rows": [row]},
        "quality": {
            "verdict": "accept" if position < 4 else "accept with warnings",
            "findings": [{"code": "few_samples", "severity": "warning", "message": "Only 9 samples per slip."}]
            * (position == 4),
            "figures": {"samples_per_slip": {"value": 41.0, "unit": ""}, "noise": {"value": NOISE, "unit": "N"}},
        },
        "derived": {
            "periodic orbit": {
                "drop": {**entry, "validity": "nonlinear model"},
                "period": {"value": period, "unit": "s", "interval": [0.99 * period, 1.01 * period]},
            },
            "closed form": {"drop": {**entry, "validity": "not valid here (a·V_max = 9.4)"}},
        },
    }
