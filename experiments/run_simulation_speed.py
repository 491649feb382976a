"""How fast the simulation is: the speed that is asked for, beside the equally accurate event-driven program.

a. The 4 s log of the test problem at 1 mm/s (13 onsets), to 1e-8 s in the onset times: ours against
   scipy.integrate.solve_ivp (DOP853, events), each with the loosest tolerance of a ladder that keeps 1e-8 s. Ours in
   CasADi's virtual machine, as in a first run, and as machine code, as it is where a C compiler is and after much use.
b. 1,000 cycles to 1e-6 of a cycle in the onset times.
c. Time against the number of cycles: linear.

One core, one thread, warm, in turns; medians and spread of processor times. Ours is timed run after run, as a study
simulates, and as one run between runs of the other program, which has emptied the processor's caches meanwhile.

    python experiments/run_simulation_speed.py
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(variable, "1")  # before numpy: one core means one thread

import numpy as np  # noqa: E402
from numpy.typing import NDArray  # noqa: E402

sys.path.insert(0, str(Path(__file__).parents[1]))

from experiments.machine import describe  # noqa: E402
from experiments.rivals import Law, onsets_by_events  # noqa: E402
from experiments.study_problem import DEMO, RIG  # noqa: E402
from experiments.workprec import one_core  # noqa: E402
from identify.base import native  # noqa: E402
from identify.effects import MAIN  # noqa: E402
from identify.model.model import Model, assemble  # noqa: E402
from identify.simulation import stepper  # noqa: E402
from identify.simulation.plan import Stepping  # noqa: E402
from identify.simulation.simulate import run  # noqa: E402
from identify.simulation.steppers import HIGH  # noqa: E402

Array = NDArray[np.float64]

TRUTH = DEMO | RIG
SPEED, DURATION, ONSETS_TO = 1e-3, 4.0, 1e-8
FASTER, CYCLES, CYCLES_TO, CYCLES_WITHIN = 20.0, 1000, 1e-6, 1.0  # what is asked for: ratio, cycles, error, s
MANY_RTOL = 1e-8
ROW = 20  # runs after each other
WARM = 12  # runs after which machine code is looked for, and found
TOLERANCES = tuple(float(f"{m}e-{e}") for e in range(4, 11) for m in (7, 5, 3, 2, 1))


@dataclass(frozen=True)
class Timing:
    """Repeated processor times [s]."""

    seconds: tuple[float, ...]

    @property
    def median(self) -> float:
        """Their median [s]."""
        return float(np.median(self.seconds))

    def each_of(self, count: int) -> Timing:
        """Of one run, where so many were timed together."""
        return Timing(tuple(s / count for s in self.seconds))

    def over(self, other: Timing) -> float:
        """Median of the ratios turn by turn: a machine that others use is not as fast in one turn as in another."""
        return float(np.median(np.array(self.seconds) / other.seconds))

    def __str__(self) -> str:
        return f"{1e3 * self.median:8.2f} ms ({1e3 * min(self.seconds):.2f} to {1e3 * max(self.seconds):.2f})"


@dataclass(frozen=True)
class Figures:
    """a: tolerance, error [s] and time of ours (run after run) and of the rival, of one run of ours between runs of the
    rival, and the first two times with machine code, where there is a compiler; b: error (of a cycle) and time; c:
    times by cycles."""

    ours: tuple[float, float, Timing]
    rival: tuple[float, float, Timing]
    between: Timing
    native: tuple[Timing, ...] | None
    many: tuple[float, Timing]
    by_cycles: dict[int, float]

    @property
    def times_faster(self) -> float:
        """Median over the turns of the rival over ours, in the virtual machine."""
        return self.rival[2].over(self.ours[2])

    @property
    def times_faster_native(self) -> float:
        """The same with machine code; not a number without."""
        return self.native[1].over(self.native[0]) if self.native else np.nan


def in_turns(programs: list[Callable[[], object]], repeats: int) -> list[Timing]:
    """Time several programs, taking turns after one untimed call each."""
    seconds: list[list[float]] = [[] for _ in programs]
    for program in programs:
        program()
    for _ in range(repeats):
        for program, times in zip(programs, seconds, strict=True):
            since = time.process_time()
            program()
            times.append(time.process_time() - since)
    return [Timing(tuple(times)) for times in seconds]


@contextmanager
def machine_code(model: Model | None) -> Iterator[bool]:
    """With the bursts of a model as machine code; without a model, with none. Says whether there is any."""
    before, known = dict(os.environ), (native.compiler, native.folder)
    with TemporaryDirectory() as cache:
        os.environ |= {"STICKSLIP_COMPILE": "0" if model is None else "1", "STICKSLIP_CACHE": cache}
        for function in known:
            function.cache_clear()
        stepper.forget()
        try:
            yield model is not None and stepper.hastened(model, HIGH)
        finally:
            native.wait()
            os.environ.clear()
            os.environ |= before
            for function in known:
                function.cache_clear()
            stepper.forget()


def loosest(program: Callable[[float], Array], truth: Array) -> tuple[float, float]:
    """The loosest tolerance from which on every onset is within ONSETS_TO, and the error there [s]."""
    kept = (0.0, np.inf)
    for tolerance in reversed(TOLERANCES):
        found = program(tolerance)
        error = float(np.max(np.abs(found - truth))) if found.size == truth.size else np.inf
        if error > ONSETS_TO:
            break
        kept = (tolerance, error)
    return kept


def main(fast: bool = False) -> Figures:
    """Measure and print. fast: few repetitions, 100 cycles."""
    repeats, cycles = (3, 100) if fast else (41, CYCLES)
    model, law = assemble(MAIN), Law(TRUTH, SPEED, 1.0)

    def ours(rtol: float, duration: float = DURATION) -> Array:
        return run(model, TRUTH, SPEED, 1.0, duration, accuracy=Stepping(rtol, HIGH)).onsets

    def theirs(rtol: float) -> Array:
        return onsets_by_events(law, DURATION, rtol)

    print(describe())
    with one_core(), machine_code(None):
        truth = ours(1e-13)
        # The independent program at its tightest says the same.
        apart = float(np.max(np.abs(truth - theirs(1e-12))))
        (mine, my_error), (their, their_error) = loosest(ours, truth), loosest(theirs, truth)

        def row() -> None:
            for _ in range(ROW):
                ours(mine)

        pair: list[Callable[[], object]] = [row, lambda: theirs(their), lambda: ours(mine)]
        timings = in_turns(pair, repeats)
        with machine_code(model) as there:
            for _ in range(WARM):
                ours(mine)
            fast = in_turns(pair[:2], repeats) if there else None
        hastened = None if fast is None else (fast[0].each_of(ROW), fast[1])
        period = float(np.mean(np.diff(truth[1:])))
        duration = period * cycles
        exact, found = ours(1e-13, duration), ours(MANY_RTOL, duration)
        error = float(np.max(np.abs(found - exact))) / period
        (many,) = in_turns([lambda: ours(MANY_RTOL, duration)], max(repeats // 4, 2))
        counts = [cycles // 8, cycles // 4, cycles // 2, cycles]
        by_cycles = {n: in_turns([lambda n=n: ours(MANY_RTOL, n * period)], 3)[0].median for n in counts}  # type: ignore[misc]
    figures = Figures(
        (mine, my_error, timings[0].each_of(ROW)),
        (their, their_error, timings[1]),
        timings[2],
        hastened,
        (error, many),
        by_cycles,
    )
    report(figures, truth.size, apart)
    return figures


def report(f: Figures, onsets: int, apart: float) -> None:
    """Print the figures beside what is asked for."""
    print(
        f"\na. {onsets} onsets in {DURATION:g} s at 1 mm/s to {ONSETS_TO:g} s "
        f"(truth: two programs, {apart:.0e} s apart)"
    )
    for name, (tolerance, error, timing) in (("ours", f.ours), ("solve_ivp", f.rival)):
        print(f"   {name:10} rtol {tolerance:.0e}  error {error:.1e} s  {timing}")
    print(f"   times faster {f.times_faster:6.1f}   asked: at least {FASTER:g}")
    print(f"   one run of ours between runs of the other {f.between}  times faster {f.rival[2].over(f.between):6.1f}")
    if f.native is not None:
        print(f"   as machine code: ours {f.native[0]}  solve_ivp {f.native[1]}")
        print(f"   times faster {f.times_faster_native:6.1f}")
    error, many = f.many
    count = max(f.by_cycles)
    print(f"b. {count} cycles: error {error:.1e} of a cycle  {many}   asked: {CYCLES_TO:g} within {CYCLES_WITHIN:g} s")
    per_cycle = ", ".join(f"{n}: {1e6 * seconds / n:.0f}" for n, seconds in f.by_cycles.items())
    print(f"c. microseconds per cycle, by cycles: {per_cycle}")


if __name__ == "__main__":
    main("--fast" in sys.argv[1:])
