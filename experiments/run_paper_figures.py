"""The paper's figures 2 to 6 again, printed and derived forms side by side, as docs/printed_errors.md shows them.

The paper's pictures are lost; the text states the normal force, drive speed, stiffness, D and t_cr of its test, and no
mass, damping or coefficient of friction: these are drawn as ranges. A simulated pair, fitted from its logs, stands in
for the one that was measured, with its confidence region.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parents[1])]

import machine  # noqa: E402
import matplotlib  # noqa: E402
import paper_figures as figures  # noqa: E402
from paper_test import STATED, Known, assumed, box, fitted, region  # noqa: E402

DOCS = Path(__file__).parents[1] / "docs"
DPI = 300


def main(fast: bool = False) -> None:
    """Draw the figures; in the fast form into a folder that is thrown away."""
    print(machine.describe())
    if fast:
        with tempfile.TemporaryDirectory() as folder:
            write(assumed(), Path(folder), dpi=60)
        return
    write(fitted(), DOCS, DPI)


def write(known: Known, docs: Path, dpi: int) -> None:
    """All figures into docs/paper; what is placed on them is printed."""
    (docs / "paper").mkdir(parents=True, exist_ok=True)
    with matplotlib.rc_context(figures.STYLE):
        drawn = {
            "figure_2": figures.force_over_time(),
            "figure_3": figures.phase_plane(),
            "figure_4": figures.amplitudes(known),
            "figure_5": figures.critical_loadings(known),
            "figure_6": figures.critical_frictions(known),
        }
        for name, figure in drawn.items():
            figure.savefig(docs / "paper" / f"{name}.png", dpi=dpi, metadata={"Software": None})
    print("stated:", ", ".join(f"{name} = {value:.4g}" for name, value in STATED.items()))
    for name, (low, high) in box().items():
        print(f"range of {name} over what is not stated: {low:.4g} to {high:.4g}")
    for x, y in (("overshoot", "alpha"), ("alpha", "loading"), ("zeta", "Pi")):
        centre, _, error = region(known, x, y)
        print(f"stand-in: {x} = {centre[0]:.5g} ± {error[0]:.2g}, {y} = {centre[1]:.5g} ± {error[1]:.2g}")
    print(f"{len(drawn)} figures")


if __name__ == "__main__":
    main(fast="--fast" in sys.argv)
