"""A slip of an uneven track as a filter, and its chain from cycle to cycle: CasADi functions with exact derivatives.

Forces are over the load: the normal force is 1, and stiffness, damping and mass are divided by it. A slip is the
model of docs/equations.md with inertia, damper and contact ageing (nothing ages while it slides), plus what differs
along the track: the level's change since the onset, fine roughness, and a strength of each stick. Of what a stick had
at its onset (`begun`), the share `left` remains: d left/du = -(1 + s (1 - 2 left/begun))/D, s = tanh(shape): for s = 0
it falls in proportion to sliding, for s = -1 exponentially, for s = 1 it stays and then falls.

Every function has a reverse one, which takes derivatives by its results back to those by its arguments, so that the
gradient of a likelihood costs about three likelihoods, however many parameters there are.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache

import casadi as ca

from identify.base.compiled import Compiled, Mapped

# Logarithms of these are searched, in this order.
PARAMETERS = ("strength", "weakening_rate", "t_cr", "mass", "level_wander", "strength_scatter", "level_roughness")
# Searched along with them, by their priors: logarithm of the damping ratio of the rig; the damping ratio of friction
# in proportion to sliding speed; and how the weakening bends.
NUISANCES = ("damping", "speed_term", "weakening_shape")
THETA = (*PARAMETERS, *NUISANCES)
RIG = ("stiffness", "rate", "noise", "load")  # over the load: [1/m], of the sticks [1/s], sd of a sample; load [N]
STATES = ("elongation", "speed", "left", "level_change", "fine")
# Of a stick: force, time from rest and speed at the first sample, strength then with its growth [1/s], after a long
# rest, share of that left at the first sample, and its slope by sliding [1/m].
ONSET = ("onset", "earlier", "speed", "regained", "growth", "full", "left", "slope")
KEPT = ("level", "strength", "begun", "D", "wandering", "rough", "mass", "damper", "speed_slope", "shape")
CYCLE = ("log_strength", "log_strength_sd", "level")  # what the chain returns of a cycle, beside the level after it
N = len(STATES)

ROUGHNESS_LENGTH = 6e-6  # [m] 3 to 8 um fit measured records about equally
START_SPEED = (0.5, 0.3)  # sd of the speed at the first sample: of itself, and of the drive speed
HUBER = 4.0  # sd beyond which an innovation counts by its size, not its square
FIRST_SLID, ONSET_STEPS = 1e-6, 32  # share of the sliding at the first sample where the onset begins, and steps to it


@dataclass(frozen=True, eq=False)
class SlipFunctions:
    """For many rows at once; theta (10,) as THETA has it, rig (4,) as RIG.

    onset: (theta, rig, stick (5,): fallen [1], line [1], rest [s], usual rest [s], 1 where the rest is known) -> ONSET;
    begin: (theta, onset, rig, place (2,): log strength, fallen) -> state of the filter, and KEPT; step: (state, kept,
    rig, sample (2,): time step [s], force [1]) -> state; arrest: (state, kept, rig, end (2,): height above the next
    line [1], that line [1]) -> log likelihood, level's change, its variance; aged: (theta, contact (2,): rest [s],
    usual rest [s]) -> usual strength after the rest.
    *_back: (arguments, derivatives by the result) -> derivatives by all arguments that depend on theta.
    """

    onset: Mapped
    onset_back: Mapped
    begin: Mapped
    begin_back: Mapped
    step: Mapped
    step_back: Mapped
    arrest: Mapped
    arrest_back: Mapped
    aged: Mapped
    state_size: int = N + N * (N + 1) // 2 + 1  # of the filter


@cache
def slip_functions() -> SlipFunctions:
    """The functions of a slip."""
    (all_theta, theta), contact = _symbols("theta", THETA), ca.SX.sym("contact", 2)
    after, usual = (_regained(each, ca.exp(theta["t_cr"])) for each in ca.vertsplit(contact))
    aged = ca.Function("aged", [all_theta, contact], [ca.exp(theta["strength"]) * after / usual])
    return SlipFunctions(*_onset(), *_begin(), *_step(), *_arrest(), Mapped(aged))


def chain_functions(nodes: int) -> tuple[Compiled, Compiled]:
    """From cycle to cycle, for so many nodes of a stick's strength, and back; they hold buffers, so one per thread."""
    forward, back = _chain(nodes)
    return Compiled(forward), Compiled(back)


def _symbols(name: str, names: Sequence[str]) -> tuple[ca.SX, dict[str, ca.SX]]:
    vector = ca.SX.sym(name, len(names))
    return vector, dict(zip(names, ca.vertsplit(vector), strict=True))


def _both(name: str, given: Sequence[ca.SX], result: ca.SX, back_to: int) -> tuple[Mapped, Mapped]:
    """A function, and its reverse by the first so many arguments."""
    seed = ca.SX.sym("seed", result.numel())
    turned = ca.jtimes(result, ca.vertcat(*given[:back_to]), seed, True)
    ends = [sum(part.numel() for part in given[:i]) for i in range(back_to + 1)]
    parts = [ca.densify(part) for part in ca.vertsplit(turned, ends)]
    return (
        Mapped(ca.Function(name, given, [ca.densify(result)], {"cse": True})),
        Mapped(ca.Function(f"{name}_back", [*given, seed], parts, {"cse": True})),
    )


def _values(theta: Mapping[str, ca.SX], rig: Mapping[str, ca.SX]) -> dict[str, ca.SX]:
    """The quantities of a slip, over the load."""
    values = {name: ca.exp(theta[name]) for name in PARAMETERS}
    values["mass"] /= rig["load"]
    critical = 2.0 * ca.sqrt(rig["stiffness"] * values["mass"])
    values |= {"damper": critical * ca.exp(theta["damping"]), "speed_slope": critical * theta["speed_term"]}
    return values | {
        "shape": ca.tanh(theta["weakening_shape"]),
        "wandering": values["level_wander"] ** 2,
        "rough": values["level_roughness"] ** 2,
    }


def _rounded(share: ca.SX) -> ca.SX:
    """A share of strength that is left, never below zero, with smooth derivatives."""
    return 0.5 * (share + ca.sqrt(share**2 + 0.05**2))


def _rates(x: Mapping[str, ca.SX], kept: Mapping[str, ca.SX], rig: Mapping[str, ca.SX]) -> dict[str, ca.SX]:
    """Rates of STATES in a slip; level and roughness are moved by `_sliding`."""
    drive, left = rig["rate"] / rig["stiffness"], _rounded(x["left"])
    level = kept["level"] + x["level_change"] + x["fine"]
    friction = level + kept["strength"] * left + kept["speed_slope"] * x["speed"]
    weakening = 1.0 + kept["shape"] * (1.0 - 2.0 * left / kept["begun"])
    return {
        "elongation": drive - x["speed"],
        "speed": (_cell(x, kept, rig) - friction) / kept["mass"],
        "left": -x["speed"] / kept["D"] * weakening,
        "level_change": ca.SX(0.0),
        "fine": ca.SX(0.0),
    }


def _cell(x: Mapping[str, ca.SX], kept: Mapping[str, ca.SX], rig: Mapping[str, ca.SX]) -> ca.SX:
    """Force of spring and damper, which the load cell shows."""
    return rig["stiffness"] * x["elongation"] + kept["damper"] * (rig["rate"] / rig["stiffness"] - x["speed"])


def _regained(rest: ca.SX, t_cr: ca.SX) -> ca.SX:
    """Share of the strength after a rest [s], eq. (3a), from none."""
    return -ca.expm1(-rest / t_cr)


def _onset() -> tuple[Mapped, Mapped]:
    """A stick's end: from where loading alone has moved the mass to the first sample that is off the stick line."""
    (all_theta, theta), (all_rig, rig) = _symbols("theta", THETA), _symbols("rig", RIG)
    stick = ca.SX.sym("stick", 5)
    fallen, line, rest, usual, known = ca.vertsplit(stick)
    value, k, rate = _values(theta, rig), rig["stiffness"], rig["rate"]
    slid, first = fallen / k, FIRST_SLID * fallen / k
    full = value["strength"] / _regained(usual, value["t_cr"])
    begun = _regained(rest, value["t_cr"])
    kept = value | {"level": ca.SX(0.0), "strength": full, "begun": begun, "D": full / value["weakening_rate"]}
    start = (full * _rounded(begun) - value["damper"] * rate / k) / k
    time = (6.0 * value["mass"] * first / rate) ** (1.0 / 3.0)
    y = ca.vertcat(time, 0.5 * rate * time**2 / value["mass"], begun)

    def slope(log_slid: float, y: ca.SX) -> ca.SX:
        u = first * math.exp(log_slid)
        rest_of_it = {"level_change": ca.SX(0.0), "fine": ca.SX(0.0)}
        x = {"elongation": start + rate / k * y[0] - u, "speed": y[1], "left": y[2], **rest_of_it}
        rates = _rates(x, kept, rig)
        return u / y[1] * ca.vertcat(1.0, rates["speed"], rates["left"])

    h = -math.log(FIRST_SLID) / ONSET_STEPS
    for i in range(ONSET_STEPS):
        a = slope(i * h, y)
        b = slope((i + 0.5) * h, y + 0.5 * h * a)
        c = slope((i + 0.5) * h, y + 0.5 * h * b)
        y = y + h / 6.0 * (a + 2.0 * b + 2.0 * c + slope((i + 1) * h, y + h * c))
    rested = ca.fmax(rest - y[0], 1e-3 * usual)
    share = _regained(rested, value["t_cr"])
    growth = known * full * (1.0 - share) / value["t_cr"]
    left, by_sliding = y[2] + share - begun, slope(ONSET_STEPS * h, y)[2] / slid
    result = ca.vertcat(line - rate * y[0], y[0], y[1], full * share, growth, full, left, by_sliding)
    return _both("onset", [all_theta, all_rig, stick], result, 1)


def _begin() -> tuple[Mapped, Mapped]:
    """State of the filter at the first sample, and what a slip keeps."""
    (all_theta, theta), (all_rig, rig) = _symbols("theta", THETA), _symbols("rig", RIG)
    (all_onset, onset), place = _symbols("onset", ONSET), ca.SX.sym("place", 2)
    value, k = _values(theta, rig), rig["stiffness"]
    log_strength, slid, drive = place[0], place[1] / k, rig["rate"] / k
    begun = onset["regained"] / onset["full"]
    kept = value | {
        "level": onset["onset"] - ca.exp(log_strength),
        "strength": ca.exp(log_strength) / _rounded(begun),
        "begun": begun,
        "D": onset["full"] / value["weakening_rate"],
    }
    start = (onset["onset"] - value["damper"] * drive) / k
    x = ca.vertcat(start + drive * onset["earlier"] - slid, onset["speed"], onset["left"], 0.0, 0.0)
    along = ca.vertcat(-1.0, 0.0, onset["slope"], 0.0, 0.0)
    speed_variance = (START_SPEED[0] * onset["speed"] + START_SPEED[1] * drive) ** 2
    fine = -kept["rough"] * ca.expm1(-2.0 * slid / ROUGHNESS_LENGTH)
    variances = ca.diag(ca.vertcat(0.0, speed_variance, 0.0, kept["wandering"] * slid, fine))
    covariance = along @ along.T * (rig["noise"] / k) ** 2 + variances
    result = ca.vertcat(x, _upper(covariance), 0.0, *(kept[name] for name in KEPT))
    return _both("begin", [all_theta, all_onset, all_rig, place], result, 2)


def _sliding(
    x: Mapping[str, ca.SX], way: ca.SX, kept: Mapping[str, ca.SX]
) -> tuple[ca.SX, list[ca.SX], list[ca.SX], ca.SX]:
    """Noises (4,), level's change and roughness over a way [m]: means, values at its end; the noises' covariance."""
    noises = ca.SX.sym("noises", 4)
    share = way / ROUGHNESS_LENGTH + 1e-6
    gone = -ca.expm1(-share)
    grown, rough = kept["wandering"] * way, kept["rough"]
    spread = ca.diag(ca.vertcat(grown, grown / 12.0, rough * gone * (2.0 - gone), 0.0))
    spread[3, 3] = rough * (2.0 * share - 2.0 * gone - gone * gone) / (share * share)
    spread[2, 3] = spread[3, 2] = rough * gone * gone / share
    means = [x["level_change"] + 0.5 * noises[0] + noises[1], gone / share * x["fine"] + noises[3]]
    return noises, means, [x["level_change"] + noises[0], (1.0 - gone) * x["fine"] + noises[2]], spread


def _step() -> tuple[Mapped, Mapped]:
    """From one sample to the next by the midpoint rule, roughness by its mean; then the sample is seen."""
    (all_kept, kept), (all_rig, rig) = _symbols("kept", KEPT), _symbols("rig", RIG)
    sample, (mean, covariance, total, state) = ca.SX.sym("sample", 2), _filter_state()
    h, force = ca.vertsplit(sample)
    x = dict(zip(STATES, ca.vertsplit(mean), strict=True))
    speed = 0.5 * (x["speed"] + ca.sqrt(x["speed"] ** 2 + (rig["rate"] / rig["stiffness"]) ** 2))
    noises, means, ends, spread = _sliding(x, speed * h, kept)
    half = x | dict(zip(STATES[3:], means, strict=True))
    middle = {name: half[name] + 0.5 * h * rate for name, rate in _rates(half, kept, rig).items()}
    after = {name: x[name] + h * rate for name, rate in _rates(middle, kept, rig).items()}
    after |= dict(zip(STATES[3:], ends, strict=True))
    moved = ca.vertcat(*after.values())
    forward, noisy, moved = (
        ca.substitute(q, noises, ca.SX.zeros(4)) for q in (ca.jacobian(moved, mean), ca.jacobian(moved, noises), moved)
    )
    covariance = forward @ covariance @ forward.T + noisy @ spread @ noisy.T
    shown = _cell(dict(zip(STATES, ca.vertsplit(moved), strict=True)), kept, rig)
    by_x = ca.jacobian(_cell(x, kept, rig), mean)
    result = _observed(moved, _symmetric(_upper(covariance), N), total, force - shown, by_x, rig["noise"] ** 2)
    return _both("step", [state, all_kept, all_rig, sample], result, 2)


def _arrest() -> tuple[Mapped, Mapped]:
    """The end of a slip: the energy of the mass at the last sample is what friction takes on the rest of the way, down
    to the line of the next stick; and slips end the sooner the stronger friction is at their end."""
    (all_kept, kept), (all_rig, rig) = _symbols("kept", KEPT), _symbols("rig", RIG)
    end, (mean, covariance, total, state) = ca.SX.sym("end", 2), _filter_state()
    above, line = ca.vertsplit(end)
    x, k = dict(zip(STATES, ca.vertsplit(mean), strict=True)), rig["stiffness"]
    noises, means, ends, spread = _sliding(x, above / k, kept)
    by_speed = 2.0 / 3.0 * kept["speed_slope"] * x["speed"]  # over a way on which the mass is slowed evenly
    slowing = kept["level"] + sum(means) + by_speed - line - 0.5 * above
    excess = 0.5 * kept["mass"] * x["speed"] ** 2 - slowing * (above + kept["damper"] * x["speed"]) / k
    at_rest = ca.vertcat(ends[0], kept["level"] + sum(ends) - line)
    by_both = ca.jacobian(ca.vertcat(excess, at_rest), ca.vertcat(mean, noises))
    excess, error, at_rest, by_both = (
        ca.substitute(q, noises, ca.SX.zeros(4)) for q in (excess, rig["noise"] * slowing / k, at_rest, by_both)
    )
    both, size = ca.vertcat(mean, ca.SX.zeros(4)), N + 4
    seen = _observed(both, ca.diagcat(covariance, spread), total, -excess, by_both[0, :], error**2)
    level, margin = ca.vertsplit(at_rest + by_both[1:, :] @ (seen[:size] - both))
    spread = by_both[1:, :] @ _symmetric(seen[size:-1], size) @ by_both[1:, :].T
    # The mean of friction less force where it is positive; weighted with it, the level is higher and better known.
    strongest = 0.5 * (margin + ca.sqrt(margin**2 + 2.0 / ca.pi * spread[1, 1]))
    variance = spread[0, 0] - spread[0, 1] ** 2 / (strongest**2 + spread[1, 1])
    result = ca.vertcat(seen[-1] + ca.log(strongest), level + spread[0, 1] / strongest, variance)
    return _both("arrest", [state, all_kept, all_rig, end], result, 2)


@cache
def _chain(nodes: int) -> tuple[ca.Function, ca.Function]:
    """A cycle after the one before: the level that this left, the stick's time, and its slip.

    (level before (2,): mean and variance; onset; slips (3 n,): log likelihood, change and variance of the level; theta;
    log strengths of the nodes; their weight; rig; least variance) -> log likelihood of the cycle, level after (2,),
    CYCLE.
    """
    (all_theta, theta), (all_rig, rig) = _symbols("theta", THETA), _symbols("rig", RIG)
    all_onset, onset = _symbols("onset", ONSET)
    before, eta, weight = ca.SX.sym("before", 2), ca.SX.sym("eta", nodes), ca.SX.sym("weight")
    slips, least = ca.SX.sym("slips", 3 * nodes), ca.SX.sym("least")
    scatter, strength = ca.exp(theta["strength_scatter"]), ca.exp(eta)
    level, z = onset["onset"] - strength, (eta - ca.log(onset["regained"])) / scatter
    # The rate at which spots of that strength are met while the contact strengthens: long sticks are strong spots.
    usual = rig["rate"] / strength
    hazard = usual - onset["growth"] / onset["regained"]
    hazard = 0.5 * (hazard + ca.sqrt(hazard**2 + (0.02 * usual) ** 2))
    joint = ca.log(hazard) - 0.5 * z**2 - ca.log(scatter) + eta + ca.log(weight)
    joint += -0.5 * (level - before[0]) ** 2 / before[1] - 0.5 * ca.log(before[1])
    likelihood, change, variance = ca.vertsplit(slips, nodes)
    joint += likelihood
    top = ca.mmax(joint)
    share = ca.exp(joint - top)
    whole = ca.sum1(share)
    share, after = share / whole, level + change
    mean = share.T @ after
    spread = share.T @ ((after - mean) ** 2 + variance)
    spread = ca.fmax(spread, least * ca.exp(2.0 * theta["level_wander"]))
    middle = share.T @ eta
    result = ca.vertcat(ca.log(whole) + top, mean, spread)
    given = [before, all_onset, slips, all_theta, eta, weight, all_rig, least]
    seed = ca.SX.sym("seed", 3)
    back = ca.jtimes(result, ca.vertcat(*given[:4]), seed, True)
    cycle = ca.vertcat(middle, ca.sqrt(share.T @ (eta - middle) ** 2), share.T @ level)
    return (
        ca.Function("chain", given, [ca.densify(ca.vertcat(result, cycle))]),
        ca.Function("chain_back", [*given, seed], [ca.densify(back)]),
    )


def _upper(matrix: ca.SX) -> ca.SX:
    """The upper triangle, row by row."""
    return ca.vertcat(*(matrix[i, j] for i in range(matrix.shape[0]) for j in range(i, matrix.shape[0])))


def _symmetric(upper: ca.SX, n: int) -> ca.SX:
    """The matrix of an upper triangle."""
    out, entries = ca.SX(n, n), iter(ca.vertsplit(upper))
    for i in range(n):
        for j in range(i, n):
            out[i, j] = out[j, i] = next(entries)
    return out


def _filter_state() -> tuple[ca.SX, ca.SX, ca.SX, ca.SX]:
    """Mean, covariance and log likelihood so far, and all of them as one vector."""
    state = ca.SX.sym("state", N + N * (N + 1) // 2 + 1)
    return state[:N], _symmetric(state[N:-1], N), state[-1], state


def _observed(x: ca.SX, covariance: ca.SX, total: ca.SX, off: ca.SX, by_x: ca.SX, noise: ca.SX) -> ca.SX:
    """The filter's state after an observation that is off by so much; large innovations count less (Huber)."""
    gains = covariance @ by_x.T
    variance = by_x @ gains + noise
    size = ca.sqrt(off * off / variance)
    far = ca.fmax(size / HUBER, 1.0)
    total = total - 0.5 * ca.log(variance) - 0.5 * (size / far) ** 2 - HUBER * (size - size / far)
    return ca.vertcat(x + gains * (off / (far * variance)), _upper(covariance - gains @ gains.T / variance), total)
