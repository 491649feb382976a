"""Where steady sliding loses stability: growth of a 1e-6 disturbance, simulated, around the critical stiffness.

The limit is Pi = Pi_fc of docs/equations.md, section 6; the growth rate must change sign between 0.97 and 1.03 of it.
"""

from __future__ import annotations

import sys
from pathlib import Path

sys.path[:0] = [str(Path(__file__).parents[1])]

from experiments.growth_rates import FIXED_DAMPER, pairs  # noqa: E402
from experiments.machine import describe  # noqa: E402

SHARES = (0.97, 1.0, 1.03)
SETS, FEW = 20, 3


def main(fast: bool = False) -> bool:
    """Print the table; whether every set changes sign."""
    print(describe())
    print()
    print(
        "Growth rate over angular frequency of a disturbance of steady sliding, at shares of the critical stiffness\n"
    )
    heads = [f"at {share:g}" for share in SHARES]
    print(
        "| damper | m [kg] | k_c [N/m] | closed form | zeta at k_c | v_0/v_cr |", " | ".join(heads), "| changes sign |"
    )
    print("| --- | ---: | ---: | ---: | ---: | ---: |", " | ".join(["---:"] * len(heads)), "| --- |")
    good = True
    for pair in pairs(FEW if fast else SETS):
        k = pair.critical()
        rates = [rate / frequency for rate, frequency in map(pair.rate, SHARES)]
        changes = rates[0] > 0.0 > rates[-1]
        good &= changes
        fixed = pair.effects == FIXED_DAMPER
        weakening = (pair.mu_s - pair.mu_k0) * pair.load * pair.t_cr / pair.D
        # docs/equations.md, section 6: weakening = c (1 + k t_cr^2 / (m + c t_cr)) with the damping constant c held.
        c, t = pair.viscous, pair.t_cr
        known = (weakening - c) / c * (pair.mass + c * t) / t**2
        row = ["fixed c" if fixed else "h / omega_n, a v > 0", f"{pair.mass:.3g}", f"{k:.5g}"]
        row += [f"{known:.5g}" if fixed else "", f"{pair.viscous / (2 * (pair.mass * k) ** 0.5):.3g}"]
        row += [
            f"{pair.speed * pair.t_cr / pair.D:.2f}",
            *(f"{rate:+.2e}" for rate in rates),
            "yes" if changes else "NO",
        ]
        print("|", " | ".join(row), "|")
    return good


if __name__ == "__main__":
    main()
