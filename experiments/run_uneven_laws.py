"""Can an uneven record tell by which law its contacts weaken? Other laws than that of the paper, by their likelihood.

Tracks of `uneven_records.py` whose contacts are renewed in proportion to what is left of their strength, or late, or
with a direct effect beside the law of the paper, or by that law alone. Each is estimated with the law of the paper and
with others; one is named where it makes the record NAMED times as likely (logarithm) as that of the paper does. Of the
measured records the same gains are printed, where they are there. The other law is defined here, from outside the
package, and comes in by `effects.register`.

    python experiments/run_uneven_laws.py [records per law and spring [first seed]]
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).parents[1]))

import identify.effects as effects
from identify.effects.contact_ageing import ContactAgeing
from identify.effects.quantities import Situation, State, Terms


class ProportionalRenewal(ContactAgeing):
    """gamma' = (1 - gamma)/t_cr - gamma |x'|/D, the ageing law of rate-and-state friction (Ruina 1983)."""

    name = "proportional_renewal"
    says = "sliding renews the contact in proportion to what is left of its strength"
    source = "Ruina, J. Geophys. Res. 88 (1983) 10359"
    states = (State("gamma", "", start=0.0),)

    def terms(self, s: Situation) -> Terms:
        """Strengthening gamma and its rate."""
        gamma = s.x.gamma
        return Terms(strengthening=gamma, rates={"gamma": s.pace * (1 - gamma) / s.p.t_cr - gamma * s.v / s.p.D})


effects.register(ProportionalRenewal())

from experiments.machine import describe  # noqa: E402
from experiments.run_measured_records import FILES, RECORDS, sticks_in  # noqa: E402
from experiments.run_uneven_study import prepared  # noqa: E402
from experiments.uneven_records import SOFT, STIFF, Pair, simulated  # noqa: E402
from identify.uneven.estimator import maximise, start_from_features  # noqa: E402
from identify.uneven.events import Sticks, sticks_of  # noqa: E402
from identify.uneven.slip_functions import LAW  # noqa: E402

Array = NDArray[np.float64]

NAMED = 3.0  # gain of the log likelihood from which another law is named: 20 times as likely
DIRECT = 0.1  # of the strength: direct effect that a search starts at
SPRINGS = {"soft": replace(SOFT, roughness=0.011), "stiff": replace(STIFF, roughness=0.015)}


def truths(pair: Pair) -> dict[str, Pair]:
    """The pair with each of the laws."""
    return {
        "paper's": pair,
        "proportional": replace(pair, renewal="state"),
        "direct effect": replace(pair, direct=0.3 * pair.strength),
        "late": replace(pair, renewal="delayed", delay=3e-6),
    }


def gains(sticks: Sticks) -> dict[str, float]:
    """By how much each other law raises the log likelihood over that of the paper; -inf where no maximum is found."""
    first = start_from_features([sticks])
    paper = maximise([sticks], first)
    others = {
        "proportional": ((*LAW[:2], "proportional_renewal"), paper.theta),
        "direct effect": ((*LAW, "direct_effect"), np.append(paper.theta, paper.theta[0] + np.log(DIRECT))),
    }
    out = {}
    for name, (law, start) in others.items():
        found = maximise([sticks], start, law)
        out[name] = found.log_likelihood - paper.log_likelihood if found.converged else -np.inf
    return out


def named(gained: dict[str, float]) -> str:
    """The law that a record speaks for; that of the paper where no other is NAMED times as likely."""
    best = max(gained, key=lambda name: gained[name])
    return best if gained[best] > NAMED else "paper's"


def main(fast: bool = False, count: int = 15, seed: int = 0) -> dict[str, list[str]]:
    """Print what is named of each law, and the gains; fast: one record of the paper's law, stiff spring."""
    print(describe())
    print(f"{'law':14}{'spring':8}{'named':50}{'median gain of proportional, direct'}")
    out: dict[str, list[str]] = {}
    for spring, pair in SPRINGS.items():
        for law, true in truths(pair).items():
            if fast and (spring, law) != ("stiff", "paper's"):
                continue
            tracks = simulated(true, 24 if fast else 50, list(range(seed, seed + (1 if fast else count))))
            found = [gains(sticks_of(prepared(true, track.record))) for track in tracks]
            names = [named(gained) for gained in found]
            counts = ", ".join(f"{name} {names.count(name)}" for name in sorted(set(names)))
            middle = ", ".join(f"{np.median([g[name] for g in found]):+.1f}" for name in found[0])
            print(f"{law:14}{spring:8}{counts:50}{middle}", flush=True)
            out.setdefault(law, []).extend(names)
    if RECORDS.is_dir() and not fast:
        for name in FILES:
            print(name, ", ".join(f"{law} {gain:+.1f}" for law, gain in gains(sticks_in(name, RECORDS)).items()))
    return out


if __name__ == "__main__":
    main("--fast" in sys.argv, *(int(word) for word in sys.argv[1:] if word.isdigit()))
