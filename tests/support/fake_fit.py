"""A made-up Fit for tests of the report: logs of the integrator of the tests, with known scatter."""

from __future__ import annotations

from dataclasses import replace
from itertools import repeat
from typing import Any

import numpy as np

from identify.base.result import LogCurves
from identify.report.finished import Fit
from identify.scene import Scene
from tests.support import oracle

LOAD, NOISE = 1.0, 0.005
RIG_VALUES = {"mass": 0.2, "stiffness": 1470.0, "damping": 147.0}
SPEEDS = (0.1 / 6e4, 1e-4, 1e-3, 5e-3)
PARAMETERS = {
    "mu_s": (0.62, 0.0011, ""),
    "mu_k0": (0.43, 0.0009, ""),
    "delta_mu_k": (-0.13, 0.0021, ""),
    "a": (301.7, 9.3, "s/m"),
    "D": (37.42e-6, 0.21e-6, "m"),
    "t_cr": (0.5013, 0.0042, "s"),
}
TRUTH = {name: value for name, (value, *_) in PARAMETERS.items()}
EFFECTS = ["inertia", "hysteresis_damping", "contact_ageing", "velocity_weakening"]
RIG = {"mass": "0.2 kg", "stiffness": "1.47 N/mm", "zeta": 0.05, "normal_force": "1 N"}


def log_curves(speed: float, samples: int, cycles: int = 9, scatter: float = 0.0, seed: int = 0) -> LogCurves:
    """A log of so many cycles; scatter: standard deviation of the logarithm of what the sticks are strong by."""
    random = np.random.default_rng(seed)
    strengths = (float(np.exp(scatter * random.standard_normal())) for _ in repeat(None))
    longest = (cycles + 1) * (1.5 * TRUTH["mu_s"] * LOAD / (RIG_VALUES["stiffness"] * speed) + 0.1)
    motion = oracle.simulate(TRUTH | RIG_VALUES, speed, LOAD, longest, rtol=1e-6, strengths=strengths)
    onset, arrest = motion.onsets[:cycles], motion.arrests[:cycles]
    end = arrest[-1] + 0.6 * (onset[-1] - arrest[-2])
    time = np.linspace(0, end, samples)
    force, used = motion.force(time), np.arange(samples) >= samples // 40
    table = np.column_stack([onset, arrest, motion.force(onset), motion.force(arrest), random.normal(0, 1.1, cycles)])
    return LogCurves(
        name=f"pair_{speed * 6e4:g}_mm_min.txt",
        time=time,
        normal_force=LOAD * (1 - 0.05 * (1 - np.exp(-3 * time / end))) + 0.002 * random.standard_normal(samples),
        friction_force=force + NOISE * random.standard_normal(samples),
        fitted_force=np.where(used, force, np.nan),
        used=used,
        noise=NOISE,
        drive_speed=speed,
        cycles=table,
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
    return replace(fit, result={**fit.result, "provenance": {**fit.result["provenance"], "scene": scene}})


def with_parameters(fit: Fit, **changes: dict[str, Any]) -> Fit:
    """The same fit with other entries of these parameters."""
    told = {name: {**entry, **changes.get(name, {})} for name, entry in fit.result["parameters"].items()}
    return replace(fit, result={**fit.result, "parameters": told})


def with_verdicts(fit: Fit) -> Fit:
    """The same fit with every kind of verdict."""
    test, none = "a log at 5 mm/s sampled at 1 kHz or more is needed", {"standard_error": None}
    return with_parameters(
        fit,
        a={**none, "interval": [112.0, None], "verdict": "not identifiable", "reason": test},
        delta_mu_k={"interval": [-0.19, -0.08], "verdict": "weak", "reason": test},
        t_cr={**none, "interval": [None, None], "verdict": "at bound", "reason": test},
        D={**none, "interval": None, "verdict": "fixed", "reason": "fixed in the scene"},
    )


def failed(fit: Fit, status: str, message: str) -> Fit:
    """The same logs with a status other than converged: null parameters, the last iterate apart."""
    last = {name: {"value": entry["value"], "unit": entry["unit"]} for name, entry in fit.result["parameters"].items()}
    null = {name: {"value": None, "standard_error": None, "interval": None} for name in last}
    ended = with_parameters(fit, **null).result | {"status": status, "message": message, "last_iterate": last}
    return Fit(result={**ended, "correlation": None}, logs=fit.logs)


def without_cycles(fit: Fit) -> Fit:
    """The same logs with nothing detected and nothing fitted."""
    bare = tuple(replace(log, fitted_force=np.full_like(log.time, np.nan), cycles=np.empty((0, 5))) for log in fit.logs)
    message = "No log holds three complete stick-slip cycles; drive slower, or press harder, and record again."
    ended = failed(Fit(fit.result, bare), "no_cycles", message)
    return replace(ended, result={**ended.result, "gate": None, "fit": None, "derived": {}, "last_iterate": {}})


def number(value: float | None, unit: str, low: float | None, high: float | None, validity: str = "") -> dict[str, Any]:
    """An entry of a document."""
    return {"value": value, "unit": unit, "interval": [low, high], "validity": validity}


def _document(curves: tuple[LogCurves, ...]) -> dict[str, Any]:
    parameters = {}
    for name, (value, error, unit) in PARAMETERS.items():
        entry = {"value": value, "unit": unit, "standard_error": error, "level": 0.95, "verdict": "identified"}
        parameters[name] = {**entry, "interval": [value - 1.96 * error, value + 1.96 * error], "reason": ""}
    shift = {"a": {"shift": -31.0, "unit": "s/m", "in_standard_errors": -3.3}}
    draw = np.corrcoef(np.random.default_rng(5).standard_normal((6, 9)))
    return {
        "schema": 1,
        "status": "converged",
        "message": f"{len(curves)} logs and {sum(len(log.cycles) for log in curves)} cycles agree within the noise.",
        "parameters": parameters,
        "correlation": {"names": list(PARAMETERS), "matrix": draw.tolist()},
        "gate": {
            "chi2_per_sample": 1.0021,
            "worst_cycle": {"log": 1, "cycle": 7, "z": 2.9},
            "event_shift_samples": 0.08,
        },
        "fit": {"samples": sum(int(log.used.sum()) for log in curves), "cycles": 36, "iterations": 9, "rms_N": NOISE},
        "derived": {"v_cr": number(7.48e-5, "m/s", 7.3e-5, 7.7e-5, "D / t_cr")},
        "rig_sensitivity": {"mass": {**shift, "D": {"shift": None, "unit": "m", "in_standard_errors": None}}},
        "timing_s": {"read": 0.31, "solve": 0.62, "total": 1.25},
        "notes": ["The noise was estimated from straight lines through the stick phases."],
        "logs": [_log_document(i, log) for i, log in enumerate(curves, start=1)],
        "provenance": {"version": "0.1.0", "scene": {"name": "UHMWPE on skin"}, "packages": {"casadi": "3.8.2"}},
    }


def _log_document(position: int, log: LogCurves) -> dict[str, Any]:
    drop = float(np.mean(log.cycles[:, 2] - log.cycles[:, 3]))
    period = float(np.mean(np.diff(log.cycles[:, 0])))
    row = {"step": 1, "stroke": 1, "kinetic_mean_coefficient": 0.512, "static_peak_coefficient": 0.618, "drop_N": drop}
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
            "amplitude": {
                "drop": number(drop, "N", 0.98 * drop, 1.02 * drop),
                "period": number(period, "s", None, None),
            },
        },
    }
