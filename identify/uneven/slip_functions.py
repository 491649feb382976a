"""The composed model in a slip of an uneven track, as functions of CasADi with their exact derivatives.

The law of weakening, ageing at rest, rig and load cell are those of the effects; `Track` adds what differs from stick
to stick. Forces are over the load: the normal force is 1, and stiffness, damping and mass are divided by it. Every
function has a reverse one, which takes derivatives by its results back to those by its arguments, so that the
gradient of a likelihood costs about three likelihoods, however many parameters a law has.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import casadi as ca

from identify.base.compiled import Compiled, Mapped
from identify.effects import ALL
from identify.effects.quantities import Effect, Expression, Parameter, Situation, State, Terms
from identify.model.composition import Composition
from identify.model.model import assemble

# Logarithms of these are searched, in this order.
PARAMETERS = ("strength", "weakening_rate", "t_cr", "mass", "level_wander", "strength_scatter", "level_roughness")
# Searched along with them, by their priors: logarithm of the damping ratio of the rig; the damping ratio that friction
# in proportion to sliding speed makes; and how the weakening bends.
NUISANCES = ("damping", "speed_term", "weakening_shape")
THETA = (*PARAMETERS, *NUISANCES)
# Over the load: [1/m], rate of the sticks [1/s], sd of a sample [1]; and the load itself [N].
RIG = ("stiffness", "rate", "noise", "load")
ROUGHNESS_LENGTH = 6e-6  # [m] 3 to 8 um fit measured records about equally
LAW = ("inertia", "hysteresis_damping", "contact_ageing")
ROUNDED = 0.05  # of a saturated contact: over which the end of the weakening is rounded, for smooth derivatives
START_SPEED = (0.5, 0.3)  # sd of the speed at the first sample: of itself, and of the drive speed
HUBER = 4.0  # sd beyond which an innovation counts by its size, not its square
LEAST_HAZARD = 0.02  # of kappa / A: a spot is met, however fast the contact strengthens
ODD = 0.05  # share of odd slips
FIRST_SLID, ONSET_STEPS = 1e-6, 32  # of the sliding at the first sample: where the onset is followed from; steps to it
WHOLE_STEPS = 12  # in which a slip is followed of which only the ends are seen, finer towards its onset
MET = ("onset", "earlier", "speed", "regained", "rate", "full")  # and the law's states at the first sample, and slopes
OF_THE_RIG = ("mass", "damping", "speed_slope", "shape")
KEPT = ("stick_factor", "level", "full", "begun", "D", "wandering", "rough", *OF_THE_RIG)  # by a lane, through its slip
CYCLE = ("log_strength", "log_strength_sd", "level", "odd")  # found of a cycle, after it was seen
NOISES = ("level_path", "level_bridge", "fine_end", "fine_mean")


class Track(Effect):
    """What differs along the track: this stick's factor of strength, the level's change since the onset, and the fine
    roughness; and what the effects leave open of a slip: friction in proportion to speed, and the shape of the
    weakening. Contacts do not age while they slide: with ageing, the creep time is learnt from how slips begin.

    Of what a stick had at its onset (`begun`), the share g is left: dg/du = -(1 + s (1 - 2 g))/D, s = tanh(shape): for
    s = 0 it falls in proportion to sliding, for s = -1 exponentially, for s = 1 it stays and then falls.
    """

    name = "track"
    says = "what differs from stick to stick"
    source = "docs/validation.md, Real surfaces"
    parameters = (
        Parameter("stick_factor", "", -10.0, 10.0, 0.0, "", "logarithm of a stick's strength", "linear"),
        Parameter("speed_slope", "s/m", -1e9, 1e9, 0.0, "", "friction per sliding speed", "linear"),
        Parameter("shape", "", -10.0, 10.0, 0.0, "", "how the weakening bends", "linear"),
        Parameter("begun", "", 0.0, 1.0, 1.0, "", "what a stick had regained at its onset", "linear"),
    )
    states = (State("level_change", "", 0.0), State("fine", "", 0.0))

    def terms(self, s: Situation) -> Terms:
        """Level and strength; a clock that runs against time, so that nothing ages."""
        weakening = 1.0 + ca.tanh(s.p.shape) * (1.0 - 2.0 * s.x.gamma / s.p.begun)
        return Terms(
            excess=s.x.level_change + s.x.fine + s.p.speed_slope * s.v,
            strength=s.p.stick_factor,
            clock=-s.time,
            rates={"gamma": -s.v / s.p.D * weakening},
        )


@dataclass(frozen=True, eq=False)
class SlipFunctions:
    """For many lanes at once; theta (10,) as THETA has it.

    met: (theta, rig, stick (5,): fallen [1], line [1], rest [s], usual rest [s], 1 where the rest is known) -> MET;
    begin: (theta, rig, met, place (3,): log strength, variance factor of the wander, fallen) -> state of the filter and
    what a lane keeps; step: (state, kept, rig, sample (2,): time step [s], force [1]) -> state; arrest: (state, kept,
    rig, end (2,): height above the next line [1], that line [1]) -> log likelihood, level's change, its variance;
    whole: the same of a slip that was not followed, from its begin; end (2,): fallen at its end [1], the next line [1].
    aged: (theta, contact (3,): rest [s], usual rest [s], strength left before [1]) -> usual strength after the rest,
    and after a long one; motion: (state of the model, kept, rig) -> its rate [1/s].
    *_back: (arguments, derivatives by the result) -> derivatives by all arguments that depend on theta.
    """

    met: Mapped
    met_back: Mapped
    begin: Mapped
    begin_back: Mapped
    step: Mapped
    step_back: Mapped
    arrest: Mapped
    arrest_back: Mapped
    whole: Mapped
    whole_back: Mapped
    aged: Mapped
    motion: Mapped
    states: tuple[str, ...]  # of the model
    own: tuple[str, ...]  # those of the law
    state_size: int  # of the filter


def _both(name: str, given: Sequence[ca.SX], result: ca.SX, back_to: int) -> tuple[Mapped, Mapped]:
    """A function, and its reverse by the first so many arguments."""
    seed = ca.SX.sym("seed", result.numel())
    turned = ca.jtimes(result, ca.vertcat(*given[:back_to]), seed, True)
    parts = ca.vertsplit(turned, [0, *_ends(given[:back_to])])
    options = {"cse": True}
    return (
        Mapped(ca.Function(name, given, [ca.densify(result)], options)),
        Mapped(ca.Function(f"{name}_back", [*given, seed], [ca.densify(p) for p in parts], options)),
    )


def _ends(given: Sequence[ca.SX]) -> list[int]:
    out, total = [], 0
    for symbol in given:
        total += symbol.numel()
        out.append(total)
    return out


class _Slip:
    """The composed model with a track, and the symbols its functions are made of."""

    def __init__(self) -> None:
        effects = tuple(effect for effect in ALL if effect.name in LAW)
        self.m = Composition((*effects, Track()))
        self.plain = assemble(LAW)
        self.own = ["gamma"]  # states of the law
        self.theta, self.rig = ca.SX.sym("theta", len(THETA)), ca.SX.sym("rig", len(RIG))
        self.k, self.drive_rate, self.noise, load = ca.vertsplit(self.rig)
        k = self.k
        theta = dict(zip(THETA, ca.vertsplit(self.theta), strict=True))
        self.value = {name: ca.exp(theta[name]) for name in PARAMETERS}
        self.value["mass"] /= load
        self.value["damping"] = 2.0 * k * ca.exp(theta["damping"])
        self.value["speed_slope"] = theta["speed_term"] * 2.0 * ca.sqrt(k * self.value["mass"])
        self.value["shape"] = theta["weakening_shape"]
        m = self.m
        self.slip = ca.Function("slip", [m.x, m.p, m.u], [m.motion(held=False)])
        self.shown = ca.Function("shown", [m.x, m.p, m.u], [m.shown(m.x, m.rig(m.x, m.speed(m.x))[0])])
        self.pull = ca.Function("pull", [m.x, m.p, m.u], [m.rig(m.x, 0.0)[0]])
        self.kept = ca.SX.sym("kept", len(KEPT))

    def keeps(self) -> dict[str, ca.SX]:
        return dict(zip(KEPT, ca.vertsplit(self.kept), strict=True))

    def inputs(self, kept: Mapping[str, Expression]) -> ca.SX:
        """Inputs of the model: drive speed, load, direction, time."""
        return ca.vertcat(self.drive_rate / self.k, 1.0, 1.0, 0.0)

    def parameters(self, kept: Mapping[str, Expression]) -> ca.SX:
        """Parameters of the model of one stick."""
        values = {q.name: ca.SX(q.default) for q in self.m.parameters} | {
            name: kept[name] for name in ("stick_factor", "begun", "D", *OF_THE_RIG)
        }
        values |= {"mu_k0": kept["level"], "mu_s": kept["level"] + kept["full"]}
        values |= {"stiffness": self.k, "t_cr": ca.SX(1.0)}  # nothing ages in a slip
        return ca.vertcat(*(values[q.name] for q in self.m.parameters))

    def rate(self, x: ca.SX, kept: Mapping[str, Expression]) -> ca.SX:
        """dx/dt in a slip; a worn contact stays worn, rounded."""
        x, i = ca.SX(x), self.m.clamped
        if i is not None:
            x[i] = _rounded(x[i])
        return self.slip(x, self.parameters(kept), self.inputs(kept))

    def pulled(self, x: ca.SX, kept: Mapping[str, Expression]) -> ca.SX:
        """Force of the rig on a mass at rest."""
        return self.pull(x, self.parameters(kept), self.inputs(kept))

    def state(self, **values: Expression) -> ca.SX:
        return ca.vertcat(*(values.get(name, 0.0) for name in self.m.names))

    def at(self, x: ca.SX, name: str) -> ca.SX:
        return x[self.m.names.index(name)]

    def full_strength(self, usual: ca.SX) -> ca.SX:
        """Strength after a long rest, from that after the usual one."""
        return self.value["strength"] / self.regained(1.0, 0.0, usual)

    def regained(self, full: Expression, left: Expression, rest: ca.SX) -> ca.SX:
        """Strength after a rest [s]: by the ageing of the effects."""
        x = ca.SX.zeros(len(self.plain.states))
        place = [s.name for s in self.plain.states].index("gamma")
        x[place] = left
        p = ca.vertcat(*(self.value["t_cr"] if q.name == "t_cr" else ca.SX(q.default) for q in self.plain.parameters))
        return full * self.plain.rest(x, p, self.inputs(self.value), rest)[place]

    def onset(self, slid: ca.SX, kept: Mapping[str, Expression], worn: Mapping[str, Expression]) -> ca.SX:
        """Time from rest [s], speed [m/s] and the law's states after so much sliding [m]; over the logarithm of the
        sliding, from where the pull alone has moved the mass."""
        rate, drive = self.drive_rate, self.drive_rate / self.k
        balance = kept["level"] + kept["full"] * ca.exp(kept["stick_factor"]) * _rounded(worn["gamma"])
        start = (balance - self.pulled(self.state(**worn), kept)) / self.k
        first = FIRST_SLID * slid
        time = (6.0 * kept["mass"] * first / rate) ** (1.0 / 3.0)
        y = ca.vertcat(time, 0.5 * rate * time**2 / kept["mass"], *(worn[name] for name in self.own))

        def slope(log_slid: Expression, y: ca.SX) -> ca.SX:
            u = first * ca.exp(log_slid)
            own = {name: y[2 + i] for i, name in enumerate(self.own)}
            x = self.state(elongation=start + drive * y[0] - u, sliding_speed=y[1], **own)
            dx = self.rate(x, kept)
            changes = [self.at(dx, name) for name in ("sliding_speed", *self.own)]
            return u / y[1] * ca.vertcat(1.0, *changes)

        h = -float(ca.log(FIRST_SLID)) / ONSET_STEPS
        for i in range(ONSET_STEPS):
            a = slope(i * h, y)
            b = slope((i + 0.5) * h, y + 0.5 * h * a)
            c = slope((i + 0.5) * h, y + 0.5 * h * b)
            y = y + h / 6.0 * (a + 2.0 * b + 2.0 * c + slope((i + 1) * h, y + h * c))
        return ca.vertcat(y, slope(ONSET_STEPS * h, y)[2:] / slid)

    def aged(self) -> Mapped:
        """Strength after a rest."""
        contact = ca.SX.sym("contact", 3)
        rest, usual, left = ca.vertsplit(contact)
        full = self.full_strength(usual)
        result = ca.vertcat(self.regained(full, left / full, rest), full)
        return Mapped(ca.Function("aged", [self.theta, contact], [ca.densify(result)]))

    def motion(self) -> Mapped:
        """The model in a slip."""
        result = self.rate(self.m.x, self.keeps())
        return Mapped(ca.Function("motion", [self.m.x, self.kept, self.rig], [ca.densify(result)]))

    def met(self) -> tuple[Mapped, Mapped]:
        """The onset of every stick."""
        stick = ca.SX.sym("stick", 5)
        fallen, line, rest, usual, known = ca.vertsplit(stick)
        slid = fallen / self.k
        full, time = self.full_strength(usual), ca.SX.sym("time")
        worn = {s.name: ca.SX(s.start) for s in self.m.states if s.name in self.own}
        first = self.regained(1.0, 0.0, rest)
        kept = {**self.value, "stick_factor": 0.0, "level": 0.0, "full": full, "D": full / self.value["weakening_rate"]}
        kept["begun"] = first
        y = self.onset(slid, kept, {**worn, "gamma": first})
        strength = self.regained(full, 0.0, time)
        rested = ca.fmax(rest - y[0], 1e-3 * usual)
        strength, growth = (
            ca.substitute(value, time, rested) for value in (strength, known * ca.jacobian(strength, time))
        )
        n = len(self.own)
        own = y[2 : 2 + n]
        own[self.own.index("gamma")] += strength / full - first
        onset = line - self.drive_rate * y[0]
        result = ca.vertcat(onset, y[0], y[1], strength, growth, full, own, y[2 + n :])
        return _both("met", [self.theta, self.rig, stick], result, 1)

    def begin(self) -> tuple[Mapped, Mapped]:
        """State of the filter at the first sample, and what a lane keeps."""
        n = len(self.own)
        met, place = ca.SX.sym("met", len(MET) + 2 * n), ca.SX.sym("place", 3)
        onset, earlier, speed, strength, _, full = ca.vertsplit(met[: len(MET)])
        eta, odd, fallen = ca.vertsplit(place)
        k = self.k
        slid, drive = fallen / k, self.drive_rate / k
        kept = {
            **self.value,
            "stick_factor": eta - ca.log(full * _rounded(strength / full)),
            "level": onset - ca.exp(eta),
            "full": full,
            "begun": strength / full,
            "D": full / self.value["weakening_rate"],
            "wandering": odd * self.value["level_wander"] ** 2,
            "rough": self.value["level_roughness"] ** 2,
        }
        own = dict(zip(self.own, ca.vertsplit(met[len(MET) : len(MET) + n]), strict=True))
        slopes = dict(zip(self.own, ca.vertsplit(met[len(MET) + n :]), strict=True))
        start = (onset - self.pulled(self.state(**own), kept)) / k
        x = self.state(elongation=start + drive * earlier - slid, sliding_speed=speed, **own)
        along = self.state(elongation=-1.0, **slopes)
        spread = self.state(
            sliding_speed=(START_SPEED[0] * speed + START_SPEED[1] * drive) ** 2,
            level_change=kept["wandering"] * slid,
            fine=-kept["rough"] * ca.expm1(-2.0 * slid / ROUGHNESS_LENGTH),
        )
        covariance = along @ along.T * (self.noise / k) ** 2 + ca.diag(spread)
        result = ca.vertcat(x, _upper(covariance), 0.0, *(kept[name] for name in KEPT))
        return _both("begin", [self.theta, met, self.rig, place], result, 2)

    def sliding(
        self, change: ca.SX, fine: ca.SX, way: ca.SX, kept: Mapping[str, Expression], noises: ca.SX
    ) -> tuple[tuple[ca.SX, ca.SX], tuple[ca.SX, ca.SX], ca.SX]:
        """Level's change and fine roughness on a way of sliding [m]: their means over it, what they are at its end, and
        the covariance of the noises in both."""
        share = way / ROUGHNESS_LENGTH + 1e-6
        gone = -ca.expm1(-share)
        grown, rough = kept["wandering"] * way, kept["rough"]
        spread = ca.diag(ca.vertcat(grown, grown / 12.0, rough * gone * (2.0 - gone), 0.0))
        spread[3, 3] = rough * (2.0 * share - 2.0 * gone - gone * gone) / (share * share)
        spread[2, 3] = spread[3, 2] = rough * gone * gone / share
        means = change + 0.5 * noises[0] + noises[1], gone / share * fine + noises[3]
        return means, (change + noises[0], (1.0 - gone) * fine + noises[2]), spread

    def step(self) -> tuple[Mapped, Mapped]:
        """From one sample to the next, by the midpoint rule; fine roughness enters by its mean over the step, exact
        for a given speed; then the sample is seen."""
        n, sample = len(self.m.names), ca.SX.sym("sample", 2)
        h, force = ca.vertsplit(sample)
        x, covariance, total, state = _filter_state(n)
        kept, noises = self.keeps(), ca.SX.sym("noises", len(NOISES))
        v, b, fine = (self.at(x, q) for q in ("sliding_speed", "level_change", "fine"))
        p, u = self.parameters(kept), self.inputs(kept)
        speed = 0.5 * (v + ca.sqrt(v * v + u[0] ** 2))
        i, j = (self.m.names.index(q) for q in ("level_change", "fine"))
        mean = ca.SX(x)
        (mean[i], mean[j]), ends, spread = self.sliding(b, fine, speed * h, kept, noises)
        middle = mean + 0.5 * h * self.rate(mean, kept)
        after = x + h * self.rate(middle, kept)
        after[i], after[j] = ends
        forward, noisy, after = (
            ca.substitute(q, noises, ca.SX.zeros(len(NOISES)))
            for q in (ca.jacobian(after, x), ca.jacobian(after, noises), after)
        )
        covariance = _symmetric(_upper(forward @ covariance @ forward.T + noisy @ spread @ noisy.T), n)
        shown = self.shown(after, p, u)
        seen = ca.substitute(ca.jacobian(self.shown(x, p, u), x), x, after)
        result = _seen(after, covariance, total, force - shown, seen, self.noise**2)
        return _both("step", [state, self.kept, self.rig, sample], result, 2)

    def arrest(self) -> tuple[Mapped, Mapped]:
        """The end of a slip that is followed: the energy of the mass at the last sample is what friction takes on the
        rest of the way, down to the line of the next stick."""
        n, end = len(self.m.names), ca.SX.sym("end", 2)
        above, line = ca.vertsplit(end)
        x, covariance, total, state = _filter_state(n)
        kept, noises = self.keeps(), ca.SX.sym("noises", len(NOISES))
        k, damping = self.k, self.damper(kept)
        speed = self.at(x, "sliding_speed")
        means, ends, spread = self.sliding(self.at(x, "level_change"), self.at(x, "fine"), above / k, kept, noises)
        by_speed = 2.0 / 3.0 * kept["speed_slope"] * speed  # over a way on which the mass is slowed evenly
        slowing = kept["level"] + sum(means) + by_speed - line - 0.5 * above
        excess = 0.5 * kept["mass"] * speed**2 - slowing * (above + damping * speed) / k
        known, path = self.noise * slowing / k, (ends, noises, spread)
        result = self.stopped((x, covariance, total), excess, known, path, line)
        return _both("arrest", [state, self.kept, self.rig, end], result, 2)

    def damper(self, kept: Mapping[str, Expression]) -> ca.SX:
        """Force of the rig per speed of the mass [s/m]."""
        return self.pulled(ca.SX.zeros(len(self.m.names)), kept) * self.k / self.drive_rate

    def whole(self) -> tuple[Mapped, Mapped]:
        """A slip of which only onset and arrest are seen: from rest to rest, friction takes what the spring gives. The
        speed on the way, which damping and laws ask for, is that of half a period of the undamped mass."""
        n, end = len(self.m.names), ca.SX.sym("end", 2)
        fallen, line = ca.vertsplit(end)
        x, _, _, state = _filter_state(n)
        kept, noises = self.keeps(), ca.SX.sym("noises", len(NOISES))
        k, damping = self.k, self.damper(kept)
        way = fallen / k
        fastest = ca.sqrt(k / kept["mass"]) * way
        own: dict[str, Expression] = {name: self.at(x, name) for name in self.own}
        mean_friction: Expression = 0.0
        for i in range(WHOLE_STEPS):
            begin, middle, stop = (((i + part) / WHOLE_STEPS) ** 2 for part in (0.0, 0.5, 1.0))
            speed = fastest * math.sqrt(middle * (1.0 - middle))

            def slid(own: Mapping[str, Expression], share: float, speed: ca.SX = speed) -> tuple[Any, ca.SX]:
                rate = self.rate(self.state(sliding_speed=speed, **own), kept)
                return {name: share * way / speed * self.at(rate, name) for name in own}, rate

            half = {name: own[name] + change for name, change in slid(own, middle - begin)[0].items()}
            changes, rate = slid(half, stop - begin)
            own = {name: own[name] + change for name, change in changes.items()}
            friction = self.drive_rate / k * damping - damping * speed - kept["mass"] * self.at(rate, "sliding_speed")
            mean_friction += (stop - begin) * friction
        means, ends, spread = self.sliding(ca.SX(0.0), ca.SX(0.0), way, kept, noises)
        onset = self.pulled(self.state(elongation=self.at(x, "elongation")), kept)
        excess = 0.5 * (onset + line) - damping * fastest * ca.pi / 8.0 - mean_friction - sum(means)
        result = self.stopped((x, ca.SX.zeros(n, n), ca.SX(0.0)), excess, self.noise, (ends, noises, spread), line)
        return _both("whole", [state, self.kept, self.rig, end], result, 2)

    def stopped(
        self,
        filtered: tuple[ca.SX, ca.SX, ca.SX],
        excess: ca.SX,
        noise: ca.SX,
        path: tuple[tuple[ca.SX, ca.SX], ca.SX, ca.SX],
        line: ca.SX,
    ) -> ca.SX:
        """Log likelihood, and the level's change with its variance, where a mass has stopped: its balance of energy is
        seen, and slips end the sooner the stronger friction is at their end.

        Args:
            filtered: mean, covariance and log likelihood before.
            excess: what the balance is off by, known to the noise.
            path: on the way that was not seen: level's change and roughness at its end, noises, their covariance.
            line: force at rest.
        """
        x, covariance, total = filtered
        ends, noises, spread = path
        none = ca.SX.zeros(noises.numel())
        at_rest = ca.vertcat(ends[0], self.keeps()["level"] + sum(ends) - line)
        by_both = ca.jacobian(ca.vertcat(excess, at_rest), ca.vertcat(x, noises))
        excess, noise, at_rest, by_both = (ca.substitute(q, noises, none) for q in (excess, noise, at_rest, by_both))
        both = ca.vertcat(x, none)
        seen = _seen(both, ca.diagcat(covariance, spread), total, -excess, by_both[0, :], noise**2)
        found, after, total = seen[: both.numel()], _symmetric(seen[both.numel() : -1], both.numel()), seen[-1]
        level, pull = ca.vertsplit(at_rest + by_both[1:, :] @ (found - both))
        spread = by_both[1:, :] @ after @ by_both[1:, :].T
        # The mean of the pull where it is positive; weighted with it, the level is higher and better known.
        strongest = 0.5 * (pull + ca.sqrt(pull**2 + 2.0 / ca.pi * spread[1, 1]))
        variance = spread[0, 0] - spread[0, 1] ** 2 / (strongest**2 + spread[1, 1])
        return ca.vertcat(total + ca.log(strongest), level + spread[0, 1] / strongest, variance)

    def chain(self, nodes: int) -> tuple[ca.Function, ca.Function]:
        """A cycle after the one before: the level that this left, the stick's time, and its slip.

        (level before (2,): mean and variance; met, without the law's states; slips (6 n,): log likelihood, change and
        variance of the level, usual slips first; theta; log strengths of the nodes; their weight; rig; least variance)
        -> log likelihood of the cycle, level after (2,), CYCLE.
        """
        before, eta, weight = ca.SX.sym("before", 2), ca.SX.sym("eta", nodes), ca.SX.sym("weight")
        met, slips, least = ca.SX.sym("met", len(MET)), ca.SX.sym("slips", 6 * nodes), ca.SX.sym("least")
        onset, _, _, regained, growth, _ = ca.vertsplit(met)
        scatter, strength = self.value["strength_scatter"], ca.exp(eta)
        level, z = onset - strength, (eta - ca.log(regained)) / scatter
        # The rate at which spots of that strength are met while the contact strengthens: long sticks are strong spots.
        usual = self.drive_rate / strength
        hazard = usual - growth / regained
        hazard = 0.5 * (hazard + ca.sqrt(hazard**2 + (LEAST_HAZARD * usual) ** 2))
        joint = ca.log(hazard) - 0.5 * z**2 - ca.log(scatter) + eta + ca.log(weight)
        joint += -0.5 * (level - before[0]) ** 2 / before[1] - 0.5 * ca.log(before[1])
        found, change, variance = (ca.reshape(part, nodes, 2) for part in ca.vertsplit(slips, 2 * nodes))
        both = ca.horzcat(joint + found[:, 0] + ca.log(1.0 - ODD), joint + found[:, 1] + ca.log(ODD))
        top = ca.mmax(both)
        share = ca.exp(both - top)
        whole = ca.sum1(ca.sum2(share))
        share = share / whole
        after = ca.repmat(level, 1, 2) + change
        mean = ca.sum1(ca.sum2(share * after))
        spread = ca.sum1(ca.sum2(share * ((after - mean) ** 2 + variance)))
        spread = ca.fmax(spread, least * self.value["level_wander"] ** 2)
        at = ca.sum2(share)
        middle = at.T @ eta
        cycle = (middle, ca.sqrt(at.T @ (eta - middle) ** 2), at.T @ level, ca.sum1(share[:, 1]))
        result = ca.vertcat(ca.log(whole) + top, mean, spread)
        given = [before, met, slips, self.theta, eta, weight, self.rig, least]
        seed = ca.SX.sym("seed", 3)
        back = ca.jtimes(result, ca.vertcat(*given[:4]), seed, True)
        return (
            ca.Function("chain", given, [ca.densify(ca.vertcat(result, *cycle))]),
            ca.Function("chain_back", [*given, seed], [ca.densify(back)]),
        )


def _rounded(share: ca.SX) -> ca.SX:
    """A share of strength that is left, never below zero."""
    return 0.5 * (share + ca.sqrt(share**2 + ROUNDED**2))


def _upper(matrix: ca.SX) -> ca.SX:
    """The upper triangle, row by row."""
    return ca.vertcat(*(matrix[i, j] for i in range(matrix.shape[0]) for j in range(i, matrix.shape[0])))


def _symmetric(upper: ca.SX, n: int) -> ca.SX:
    """The matrix of an upper triangle."""
    out, place = ca.SX(n, n), 0
    for i in range(n):
        for j in range(i, n):
            out[i, j] = out[j, i] = upper[place]
            place += 1
    return out


def _filter_state(n: int) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX]:
    """Mean, covariance and log likelihood so far, and all of them as one vector."""
    state = ca.SX.sym("state", n + n * (n + 1) // 2 + 1)
    return state[:n], _symmetric(state[n:-1], n), state[-1], state


def _seen(x: ca.SX, covariance: ca.SX, total: ca.SX, off: ca.SX, by_x: ca.SX, noise: ca.SX) -> ca.SX:
    """The filter's state after an observation that is off by so much; large innovations count less (Huber)."""
    gains = covariance @ by_x.T
    variance = by_x @ gains + noise
    size = ca.sqrt(off * off / variance)
    far = ca.fmax(size / HUBER, 1.0)
    total = total - 0.5 * ca.log(variance) - 0.5 * (size / far) ** 2 - HUBER * (size - size / far)
    return ca.vertcat(x + gains * (off / (far * variance)), _upper(covariance - gains @ gains.T / variance), total)


@cache
def slip_functions() -> SlipFunctions:
    """The functions of the law of the effects on a track."""
    slip = _Slip()
    n = len(slip.m.names)
    return SlipFunctions(
        *slip.met(),
        *slip.begin(),
        *slip.step(),
        *slip.arrest(),
        *slip.whole(),
        slip.aged(),
        slip.motion(),
        tuple(slip.m.names),
        tuple(slip.own),
        n + n * (n + 1) // 2 + 1,
    )


@cache
def _chain(nodes: int) -> tuple[ca.Function, ca.Function]:
    return _Slip().chain(nodes)


def chain_functions(nodes: int) -> tuple[Compiled, Compiled]:
    """From cycle to cycle, for so many nodes of a stick's strength, and back; they hold buffers, so one per thread."""
    there, back = _chain(nodes)
    return Compiled(there), Compiled(back)
