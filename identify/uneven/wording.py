"""What the estimator of uneven records says to somebody in the laboratory."""

from __future__ import annotations

from collections.abc import Sequence

from identify.base.wording import three_figures
from identify.logs.prepare import Prepared
from identify.uneven.events import Sticks

UNLIKE_SLOPE = 0.25  # of the stick slope that stiffness and drive speed make: a difference that is said

SLOWER_THAN_SPRING = (
    "friction falls with sliding more slowly than the spring relaxes, so what the slips show is the level's wander and "
    "not the weakening: strength and weakening length cannot be told; a softer spring, or a slower drive, would tell"
)
NOT_FOLLOWED = (
    "only the course of a slip tells it, and these records have but a few samples of each; a higher sampling rate would"
)
NO_MAXIMUM = (
    "cycles differ, and the estimator of uneven records found no most likely answer: look for events that are no slips "
    "(stickslip inspect --plot), or take a window of steady stick-slip"
)
ONE_RECORD = "one record alone; others of the same slider would tell whether it has one mass in all"
CUT_SHORT = "the time limit ended the estimate of uneven records: a longer one, or a window of fewer cycles, tells"
# Parts of an answer that are left out, and said, where there is no time for them.
DESCRIBED, COMPARED, LEFT_OUT = "cycles described one by one", "records compared with each other", "leave-one-out"
CREEP, DRAWN = "creep time", "distributions of static peak, drop and period"
FIXED_NOT_USED = "fixed in the scene; the estimator of uneven records does not use it"

_FREED = {
    "identified": "",
    "weak": "; more cycles narrow it",
    "bounded": "; it may be nothing: only its upper end is told; more cycles, or less noise, tell",
    "not identifiable": ": these cycles do not tell it; more cycles, or less noise, tell",
}
_MEANT = {
    "strength": "onset force above the slow level after the typical rest ({rest} s), over the load; how the "
    "weakening scales with the strength is not told and moves it by about 13 %",
    "strength_scatter": "scatter of the strength from stick to stick, as a share",
    "weakening_length": "sliding in which the strength is lost",
    "mass": "from the course of the slips; the interval holds what is open of damping, stiffness, friction that "
    "changes with sliding speed and the law of weakening; what [rig] states as nominal is not used",
    "stiffness": "from the slope of the sticks over the drive speed; its error holds how far that is from [rig]",
    "damping": "h of the rig, from the course of the slips; friction that rises with sliding speed looks alike",
    "level_wander": "random walk of the friction level along the track",
    "level_roughness": "scatter of the friction level over a few micrometres",
    "t_cr": "from the strength against the rest of each stick",
}
_SPEED = (
    "a change of friction with speed is not told from the wander of the level within these slips; records at several "
    "drive speeds on the same track would tell"
)
_UNIFORM = {
    "mu_s": "the level wanders along the track, so that there is no one static coefficient; see strength, and the "
    "distribution of the static peak",
    "mu_k0": "the level wanders along the track, so that there is no one kinetic coefficient; see level_wander",
    "delta_mu_k": _SPEED,
    "a": _SPEED,
    "D": "see weakening_length, which is told without the law of a uniform pair",
}


def reason(name: str, verdict: str, rest: float) -> str:
    """What a quantity is, and where it is not identified what would tell it; rest: the typical one [s]."""
    return f"{_MEANT[name].format(rest=three_figures(rest))}{_FREED[verdict]}"


def of_a_uniform_pair(name: str) -> str:
    """Why a parameter of a uniform pair has no value."""
    return _UNIFORM.get(name, "the estimator of uneven records does not tell it")


def scatters_too_much(scatter: float) -> str:
    """Why the strength is withheld where it scatters more than a strength can."""
    return (
        f"the strength scatters by {100 * scatter:.0f} % from stick to stick, more than one law of a stick describes: "
        "strength and weakening length cannot be told; a slower drive, at which every slip ends in a rest, would tell"
    )


def lost_at_once(length: float) -> str:
    """Why the strength is withheld where the noise of a sample hides the sliding that takes it all; length [m]."""
    return (
        f"the strength seems lost within {three_figures(1e9 * length)} nm of sliding, less than the noise of a sample "
        "hides: strength and weakening length cannot be told; a slower drive, or less noise, would tell"
    )


def creep_bounded(lower: float | None, upper: float | None, rest: float) -> str:
    """A bound on one side."""
    rests = f"sticks of about {three_figures(rest)} s"
    if upper is not None:
        return (
            f"{rests} are as strong as longer ones within their scatter, so that it is below {three_figures(upper)} s; "
            "a faster drive, or holds of graded length, tell how far below"
        )
    return (
        f"the strength still grows over {rests}, so that it is above {three_figures(lower or 0.0)} s; a slower drive, "
        "or longer holds, tell how far above"
    )


def creep_if_rest_alone(upper: float, rest: float) -> str:
    """No bound from above, since part of the strength may be lost to sliding speed."""
    return (
        f"sticks of about {three_figures(rest)} s are as strong as longer ones within their scatter: below "
        f"{three_figures(upper)} s if rest alone made that strength, but friction may fall with sliding speed as well; "
        "a faster drive, or holds of graded length, would tell"
    )


def creep_untold(rest: float) -> str:
    """Neither bound within a factor that says anything."""
    return (
        f"sticks of about {three_figures(rest)} s differ too little in length, for their scatter, to tell it; several "
        "drive speeds, or holds of graded length, would tell"
    )


def too_few(name: str, usable: int, seen: int, fewest: int) -> str:
    """Too few cycles for a scatter."""
    return (
        f"{name} shows {usable} cycles whose stick and slip can be made out, of {seen} that were seen; at least "
        f"{fewest} are needed to tell how they differ: record longer, or take a window of clear stick-slip"
    )


def not_cycling(name: str) -> str:
    """A record that is no row of sticks and slips."""
    return f"{name} does not stick and slip at one drive speed; take a window of it that does"


def answered(logs: Sequence[Prepared], cycles: int, withheld: str) -> str:
    """The sentence of an answer."""
    worst = max(logs, key=lambda log: log.scatter)
    differ = (
        f"friction differs from cycle to cycle (in {worst.name} the drop changes by {100 * worst.scatter:.0f} % from "
        f"one to the next), so {cycles} cycles were described one by one instead of by one friction pair"
    )
    if withheld:
        return f"{differ}; strength and weakening length are not told: {withheld}"
    return (
        f"{differ}; strength, weakening length and their scatter hold for this drive speed, stiffness and load, and "
        "are no basis for others"
    )


def apart(values: Sequence[tuple[str, float, float, float]]) -> str:
    """Records that do not share their parameters; values: name, strength, weakening length [m] and the deviation of the
    strength's logarithm, of each by itself."""
    told = "; ".join(
        f"{name}: strength {three_figures(strength)} (within {100 * sd:.0f} %), weakening length "
        f"{three_figures(1e6 * length)} µm"
        for name, strength, length, sd in values
    )
    return (
        f"these records do not share one strength, weakening and level ({told}), so that none is told of all of them: "
        "fit the records of each drive speed and stiffness by themselves"
    )


def transferred(name: str, speed: float, holds: bool) -> str:
    """What the other records predict of one that is left out."""
    at = f"{three_figures(1e6 * speed)} µm/s"
    if holds:
        return f"Drop and period of {name} ({at}) are as the other records predict them."
    return f"Drop or period of {name} ({at}) are not as the other records predict them: what is told does not transfer."


def one_mass(
    names: Sequence[str], each: Sequence[tuple[float, float, float]], chi2: float, freedom: int, probability: float
) -> str:
    """The masses of records of one slider [kg], and how they scatter."""
    masses = "; ".join(
        f"{name} {three_figures(1e3 * value)} ({three_figures(1e3 * low)} to {three_figures(1e3 * high)}) g"
        for name, (value, low, high) in zip(names, each, strict=True)
    )
    return f"Mass by record: {masses}; {_scatter(chi2, freedom, probability)}."


def no_one_mass(chi2: float, freedom: int, probability: float) -> str:
    """Why no mass is told where records of one slider differ in it."""
    return (
        f"these records do not show one mass ({_scatter(chi2, freedom, probability)}): fit them by themselves, and "
        "weigh what moves"
    )


def _scatter(chi2: float, freedom: int, probability: float) -> str:
    return f"their scatter has χ² {three_figures(chi2)} for {freedom} degree(s) of freedom, p {probability:.2g}"


def of_bounds(names: Sequence[str]) -> list[str]:
    """What becomes of what [parameters] says of the rig beside a fixed value and a prior."""
    if not names:
        return []
    return [
        f"{', '.join(names)} under [parameters]: estimated from the data alone, without its start value and bounds."
    ]


def of_effects(unused: Sequence[str], velocity_laws: set[str]) -> list[str]:
    """What becomes of effects of the scene that the estimator does not follow."""
    out = []
    laws = [name for name in unused if name in velocity_laws]
    others = [name for name in unused if name not in velocity_laws]
    if laws:
        out.append(
            f"{', '.join(laws)}: within these slips only a change of friction in proportion to sliding speed is "
            "estimated, of either sign, and what it leaves open is in the intervals."
        )
    if others:
        out.append(
            f"Not used: {', '.join(others)}. The estimator of uneven records does not know these effects of the scene; "
            "what they do to the force counts as friction."
        )
    return out


def notes(logs: Sequence[Prepared], records: Sequence[Sticks], mass: tuple[float, float, float] | None) -> list[str]:
    """What the reader has to know of the rig and of cycles that were left out; mass: found, with its interval [kg]."""
    out = []
    stated_mass = logs[0].rig.mass
    if mass is not None and not mass[1] <= stated_mass <= mass[2]:
        found, low, high = (three_figures(1e3 * value) for value in mass)
        out.append(
            f"The slips show a moving mass of {found} g ({low} to {high}), while [rig] states "
            f"{three_figures(1e3 * stated_mass)} g: weigh what moves, or judge it from a ringing of the rig."
        )
    for log, sticks in zip(logs, records, strict=True):
        stated = log.rig.stiffness * log.data.drive_speed / log.data.mean_normal_force
        ratio = sticks.rig.rate / stated
        if abs(ratio - 1.0) > UNLIKE_SLOPE:
            out.append(
                f"{log.name}: sticks rise {100 * abs(ratio - 1.0):.0f} % {'faster' if ratio > 1 else 'slower'} than "
                "stiffness times drive speed: one of the two is not as stated, and the mass goes with the stiffness."
            )
        lost = log.segmentation.count - log.entry.skip_cycles - sticks.count
        if lost > 0:
            out.append(
                f"{log.name}: {lost} of {lost + sticks.count} cycles were left out: their slip or the sticks about it "
                "could not be made out."
            )
    out.append(
        "Extrapolated: not supported by these records, whatever is computed from these numbers for another drive "
        "speed, stiffness or load; on measured pairs such predictions were 10 to 50 % off."
    )
    return out
