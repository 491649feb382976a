"""Sentences of the estimator of uneven records."""

from __future__ import annotations

from collections.abc import Sequence

from identify.base.wording import three_figures
from identify.logs.prepare import Prepared
from identify.uneven.events import Sticks

SLOWER_THAN_SPRING = (
    "friction falls with sliding more slowly than the spring relaxes, so the slips follow the drift of the level: "
    "strength and weakening length are not identifiable; use a softer spring or a slower drive"
)
NO_MAXIMUM = (
    "cycles differ, and no most likely answer was found for uneven records: look for events that are no slips "
    "(stickslip inspect --plot), or take a window of steady stick-slip"
)
CUT_SHORT = "the time limit ended the estimate of uneven records: set a longer one, or take a window of fewer cycles"
# Parts of an answer that are left out, and named, where there is no time for them.
DESCRIBED, COMPARED = "cycles described one by one", "records compared with each other"
CREEP = "creep time"
FIXED_NOT_USED = "fixed in the scene; the estimator of uneven records does not use it"
EXTRAPOLATED = (
    "Extrapolated: not supported by these records, whatever is computed from these numbers for another drive speed, "
    "stiffness or load; on measured pairs such predictions were 10 to 50 % off."
)
_REMEDY = {
    "identified": "",
    "weak": "; more cycles narrow it",
    "bounded": "; it may be zero, only its upper end is known; record more cycles, or with less noise",
    "not identifiable": ": not identifiable from these cycles; record more of them, or with less noise",
}
_MEANING = {
    "strength": "onset force above the slow level after the typical rest ({rest} s), over the load; unknown is how the "
    "weakening scales with the strength, which moves it by about 13 %",
    "strength_scatter": "scatter of the strength from stick to stick, as a share",
    "weakening_length": "sliding in which the strength is lost",
    "mass": "from the shape of the slips; the interval includes damping, stiffness, speed dependence and the law",
    "stiffness": "from the slope of the sticks over the drive speed; its error includes the difference from [rig]",
    "damping": "h of the rig, from the shape of the slips; friction that rises with sliding speed looks alike",
    "level_wander": "random walk of the friction level along the track",
    "level_roughness": "scatter of the friction level over a few micrometres",
    "t_cr": "from the strength against the rest of each stick",
    "mu_s": "the level drifts along the track: there is no one static coefficient; see strength and the static peak",
    "mu_k0": "the level drifts along the track: there is no one kinetic coefficient; see level_wander",
    "D": "see weakening_length, which does not depend on the law of a uniform pair",
}
_SPEED = "not separable from the drift of the level within these slips; record several drive speeds on the same track"
_UNIFORM = {name: _MEANING[name] for name in ("mu_s", "mu_k0", "D")} | {"delta_mu_k": _SPEED, "a": _SPEED}


def reason(name: str, verdict: str, rest: float) -> str:
    """What a quantity is, and where it is not identified what to do; rest: the typical one [s]."""
    return f"{_MEANING[name].format(rest=three_figures(rest))}{_REMEDY[verdict]}"


def of_a_uniform_pair(name: str) -> str:
    """Why a parameter of a uniform pair has no value."""
    return _UNIFORM.get(name, "not estimated for uneven records")


def scatters_too_much(scatter: float) -> str:
    """Why the strength is withheld where it scatters more than a strength can."""
    return (
        f"the strength scatters by {100 * scatter:.0f} % from stick to stick, more than one friction law describes: "
        "strength and weakening length are not identifiable; use a slower drive, at which every slip ends in a rest"
    )


def lost_at_once(length: float) -> str:
    """Why the strength is withheld where the noise of a sample hides the sliding that takes it all; length [m]."""
    return (
        f"the strength seems lost within {three_figures(1e9 * length)} nm of sliding, less than the noise of a sample "
        "hides: strength and weakening length are not identifiable; use a slower drive, or reduce the noise"
    )


def creep(lower: float | None, upper: float | None, rest: float, by_speed: bool) -> str:
    """What bounds the creep time [s]; by_speed: friction may fall with sliding speed as well."""
    sticks = f"sticks of about {three_figures(rest)} s"
    if lower is not None:
        return f"the strength still grows over {sticks}: above {three_figures(lower)} s; use a slower drive, or holds"
    if upper is None:
        return f"{sticks} differ too little, for their scatter; use several drive speeds, or holds of graded length"
    alone = "; that is so if friction does not fall with sliding speed as well" if by_speed else ""
    return (
        f"{sticks} are as strong as longer ones within their scatter: below {three_figures(upper)} s{alone}; use a "
        "faster drive, or holds of graded length"
    )


def why_left_out(log: Prepared, usable: int, fewest_samples: int, fewest: int) -> str:
    """Why a log takes no part in the estimate, "" where it does; usable: cycles with a stick and a slip."""
    samples = log.segmentation.samples_per_slip
    if log.left_out is not None:
        return log.left_out
    if log.rig.plate is not None:
        return (
            f"{log.name}: cycles that differ are followed at a load cell at the drive only, not under the counterface"
        )
    if log.fit_mode.name != "cycles" or log.data.on_course:
        return f"{log.name} does not stick and slip at one drive speed; take a window of it that does"
    if samples < fewest_samples:
        return (
            f"{log.name}: a slip has {samples:.2g} samples, at least {fewest_samples} are needed; use a higher "
            "sampling rate"
        )
    if usable < fewest:
        return (
            f"{log.name} shows {usable} cycles whose stick and slip can be made out, of {log.segmentation.count} "
            f"detected; at least {fewest} are needed: record longer, or take a window of clear stick-slip"
        )
    return ""


def answered(logs: Sequence[Prepared], cycles: int, withheld: str) -> str:
    """The sentence of an answer."""
    worst = max(logs, key=lambda log: log.scatter)
    last = "; strength, weakening length and scatter hold for this drive speed, stiffness and load only"
    return (
        f"friction differs from cycle to cycle (in {worst.name} the drop changes by {100 * worst.scatter:.0f} % from "
        f"one to the next), so {cycles} cycles were described one by one instead of by one friction pair"
    ) + (f"; strength and weakening length are not given: {withheld}" if withheld else last)


def apart(values: Sequence[tuple[str, float, float, float]]) -> str:
    """Records that do not share their parameters; values: name, strength, weakening length [m] and the deviation of the
    strength's logarithm, of each by itself."""
    each = "; ".join(
        f"{name}: strength {three_figures(strength)} (within {100 * sd:.0f} %), weakening length "
        f"{three_figures(1e6 * length)} µm"
        for name, strength, length, sd in values
    )
    return (
        f"these records do not share one strength, weakening and level ({each}): fit the records of each drive speed "
        "and stiffness by themselves"
    )


def masses(names: Sequence[str], each: Sequence[tuple[float, float, float]], scatter: str) -> str:
    """The masses of records of one slider [kg], each with its interval, and how they scatter."""
    listed = "; ".join(f"{name} {_grams(mass)}" for name, mass in zip(names, each, strict=True))
    return f"Mass by record: {listed}; {scatter}."


def no_one_mass(scatter: str) -> str:
    """Why there is no mass where records of one slider differ in it."""
    return f"these records do not show one mass ({scatter}): fit them by themselves, and weigh what moves"


def scatter_of_masses(chi2: float, freedom: int, probability: float) -> str:
    """How the masses of records scatter."""
    return f"their scatter has χ² {three_figures(chi2)} for {freedom} degree(s) of freedom, p {probability:.2g}"


def _grams(mass: tuple[float, float, float]) -> str:
    value, low, high = (three_figures(1e3 * number) for number in mass)
    return f"{value} ({low} to {high}) g"


def of_scene(bounded: Sequence[str], laws: Sequence[str], others: Sequence[str]) -> list[str]:
    """What becomes of rig quantities under [parameters] without a prior, and of effects that are not followed: laws of
    speed, and others."""
    out = []
    if bounded:
        out.append(f"{', '.join(bounded)} under [parameters]: estimated from the data alone, without start and bounds.")
    if laws:
        out.append(f"{', '.join(laws)}: only a change of friction in proportion to sliding speed is estimated.")
    if others:
        out.append(f"Not used for uneven records: {', '.join(others)}; what they do to the force counts as friction.")
    return out


def notes(logs: Sequence[Prepared], records: Sequence[Sticks], mass: tuple[float, float, float] | None) -> list[str]:
    """Where rig and records disagree, and cycles that were left out; mass: with its interval [kg]."""
    out = []
    stated = logs[0].rig.mass
    if mass is not None and not mass[1] <= stated <= mass[2]:
        out.append(
            f"The slips show a moving mass of {_grams(mass)}, while [rig] states {three_figures(1e3 * stated)} g: "
            "weigh what moves, or judge it from a ringing of the rig."
        )
    for log, sticks in zip(logs, records, strict=True):
        ratio = sticks.rig.rate / (log.rig.stiffness * log.data.drive_speed / log.data.mean_normal_force)
        if abs(ratio - 1.0) > 0.25:
            out.append(
                f"{log.name}: sticks rise {100 * abs(ratio - 1.0):.0f} % {'faster' if ratio > 1 else 'slower'} than "
                "stiffness times drive speed: one of the two is not as stated, and the mass goes with the stiffness."
            )
        detected = log.segmentation.count - log.entry.skip_cycles
        if detected > sticks.count:
            out.append(
                f"{log.name}: {detected - sticks.count} of {detected} cycles were left out: their slip or the sticks "
                "about it could not be made out."
            )
    return out
