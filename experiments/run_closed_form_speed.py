"""How long a map of the closed forms takes: 400 x 400 operating points over drive speed and stiffness, one core.

Every point gets the whole cycle in SI (the stick saturated as far as it lasts), the groups, and both limits: whether
the mass sticks again (Phi against Phi_cr) and whether steady sliding is stable (Pi against Pi_fc).
"""

from __future__ import annotations

import sys
import time
from pathlib import Path
from types import SimpleNamespace

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parents[1])]

import machine  # noqa: E402
import numpy as np  # noqa: E402

from identify import stability  # noqa: E402
from identify.prediction.closed_forms import jump  # noqa: E402
from identify.prediction.groups import groups  # noqa: E402

PAIR = {"mu_s": 0.62, "mu_k0": 0.43, "delta_mu_k": -0.13, "D": 37.4e-6}
CASES = {  # name: a [s/m], t_cr [s], damping h [N/m]
    "sticks that saturate": (3.0, 1e-3, 147.0),
    "sticks that saturate in part": (3.0, 0.5, 147.0),
    "hardly ever saturated": (3.0, 20.0, 147.0),
    "weakening that runs away in part": (300.0, 0.5, 147.0),
    "no weakening, much damping": (0.0, 0.5, 800.0),
}


def main(fast: bool = False) -> float:
    """Print the time of every case; the longest is returned [s of CPU]."""
    side = 40 if fast else 400
    print(machine.describe())
    speed, stiffness = np.geomspace(1e-6, 1e-1, side)[:, None], np.geomspace(50, 1e5, side)[None, :]
    longest = 0.0
    for name, (a, t_cr, damping) in CASES.items():
        rig = SimpleNamespace(mass=0.2, stiffness=stiffness, damping=damping)
        friction = SimpleNamespace(**PAIR, a=a, t_cr=t_cr)
        began = time.process_time()
        cycle = jump(rig, friction, speed, 1.0)
        g = groups(rig, friction, speed, 1.0)
        sticks = np.log(g.loading) > stability.log_critical_loading(g.alpha)
        unstable = g.Pi > stability.critical_friction(g.z / 2, g.tau_cr)
        took = time.process_time() - began
        longest = max(longest, took)
        print(
            f"  {took:5.2f} s of CPU  {side} x {side}  {name}: {np.mean(cycle.status == 'restick'):.0%} stick again, "
            f"{np.mean(sticks):.0%} from a saturated contact, {np.mean(unstable):.0%} with Pi above Pi_fc"
        )
    return longest


if __name__ == "__main__":
    main(fast="--fast" in sys.argv)
