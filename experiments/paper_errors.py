"""Every printed error of the paper with its derived form, and how much it amounts to, calculated."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import paper_printed as printed
from paper_test import STATED, Known, arguments

from identify import amplitude, stability
from identify.prediction.groups import groups

FAST = 5e-3  # m/s: the fastest drive of the stand-in's logs


@dataclass(frozen=True)
class Row:
    """One error: number, equation, what is printed, what follows from the consistent model, size of the difference."""

    number: str
    equation: str
    printed: str
    derived: str
    size: str


def rows(known: Known) -> list[Row]:
    """All errors, the sizes at the paper's test with the stand-in's mass, damping and friction."""
    return [*_model(known), *_slip(known), *_boundary(known), *_sliding(known)]


def _percent(share: float) -> str:
    return f"{100 * abs(share):.2g} %"


def _model(known: Known) -> list[Row]:
    q, g = known.values, groups(*arguments(known.values))
    natural = 1 / stability.critical_frequency(g.zeta, g.tau_cr)
    pressure = 57.9 * 1e4**-0.526
    worn = q["drive_speed"] / q["D"]
    fresh = (1 - g.v_acr) / q["t_cr"]
    cross = abs(q["delta_mu_k"]) * -np.expm1(-q["a"] * g.v_cr / 2) / 2
    return [
        Row("E1", "(1)", "h/ω and h/ωn side by side", "both h/ωn, else 2ζ = h ωn/(k ω)",
            f"damping {natural:.2g} times as large at the frequency of the stability limit"),
        Row("E2", "(1)", "sliding velocity v0 − x'", "x', in the frame in which (1) is written",
            f"at rest it would be {1e3 * q['drive_speed'] * 60:.2g} mm/min, in steady sliding zero"),
        Row("E3", "(3b)", "γs increases", "only if v_acr < 1; clamped to 0 above",
            f"none at the test (v_acr = {g.v_acr:.3g}); γs = −1 at v_acr = 2"),
        Row("E4", "(4b)", "γs ≈ 1 − v0 t/D as the expansion of (3b)", "(3b) expands to (1 − v_acr) t/t_cr; "
            "(4b) starts from γs = 1", f"slope −{worn:.3g} 1/s for +{fresh:.3g} 1/s"),
        Row("E5", "(8)", "(μk0 − μk(V)) γs dropped", "kept",
            f"μ off by {cross:.2g} at half of v_cr; zero once γs = 0"),
        Row("E6", "(7)", "0.7 Fn^−0.4 = 57.9 p^−0.526", "two fits, equal only for p = 4421.7 Pa (Fn/N)^0.7605",
            f"{pressure:.3g} for 0.7 at 1 N and 10 kPa: {_percent(pressure / 0.7 - 1)}"),
        Row("E7", "(7)", "0.25 v^−0.37 (v in m/s) for the test", "a fit of fast sliding, not to be extended",
            f"μk = {0.25 * STATED['drive_speed'] ** -0.37:.2g} at 0.1 mm/min"),
    ]  # fmt: skip


def _slip(known: Known) -> list[Row]:
    q, g = known.values, groups(*arguments(known.values))
    step = q["mu_s"] - q["mu_k0"]
    rates = 1 + step * g.w / g.tau_cr, 1 + step * g.w * g.v_acr / g.tau_cr
    longer = printed.undamped(g.loading, rates[0])[0][-1] / printed.undamped(g.loading)[0][-1] - 1
    fast = groups(*arguments(known.values | {"drive_speed": FAST}))
    shift = (g.xi_o - (q["mu_k0"] * g.w - 2 * g.zeta)) / g.xi_o
    alpha, overshoot = np.array(0.2), np.array(-3.0)
    early = float(printed.maximum(alpha, overshoot)[0])
    late = float(amplitude.slip_maximum(0.2, -3.0)[0])
    return [
        Row("E8", "(9b)", "M = 1 + Δμs w/τcr", "M = 1 in fast slip (γs = 0), where ageing acts as a stiffness k − k_D; "
            "nearest consistent reading 1 + k_D/k",
            f"M = {rates[0]:.0f} for 1 (or {rates[1]:.2g}); undamped slip {_percent(longer)} too long"),
        Row("E9", "(9c)", "N = (μk0 + Δμk va) w in the frame of M", "there N = μk0 w − 2ζ; the printed N is that of "
            "the elongation", f"{_percent(shift)} of N"),
        Row("E10", "(9c)", "number used twice; (6), (6b) named for (8) and the homogeneous equation", "—", "none"),
        Row("E11", "(11)", "ξo is the displacement at the end of slip", "ξo = N, the equilibrium; the undamped slip "
            "ends at 2 ξo − ξp", f"{1e6 * step * q['normal_force'] / q['stiffness']:.0f} µm of elongation"),
        Row("E12", "(12)", "ξp = μs w", "ξp = μs w − 2ζ: the damper carries h v0/ωn",
            f"{2 * g.zeta / g.xi_p:.1g} of ξp; {_percent(2 * fast.zeta / fast.xi_p)} at 5 mm/s"),
        Row("E13", "text before (15)", "displacement and velocity become zero", "the velocity of the elongation is 1 "
            "(v0) where the mass is at rest", "v0"),
        Row("E14", "(15)", "atan", "atan2, right also for α + A < 0",
            f"none at the test; τmax = {early:.3g} for {late:.3g} at α = 0.2, A = −3"),
    ]  # fmt: skip


def _boundary(known: Known) -> list[Row]:
    q, g = known.values, groups(*arguments(known.values))
    a, A = 0.3, 2.0
    w, phi = np.sqrt(1 - a * a), 2 * a + A
    right = float(np.arctan2(w * phi, a * phi - 1) / w)
    as_printed = float(printed.acceleration_zero(np.array(a), np.array(A), 0))
    as_printed += np.pi / w if as_printed < 0 else 0.0
    inside = float(np.arctan(w * phi / (a * phi - 1) + np.pi) / w)
    step, delta = q["mu_s"] - q["mu_k0"], q["delta_mu_k"]
    off = (step - g.v_a) / (step - delta * g.v_a) - 1
    va = q["a"] * FAST
    least = float(np.min(printed.smallest_residual(np.array([0.01, 0.05, 0.1, 0.2, 0.3]))))
    curve = printed.loading_as_printed(np.array([a]), 1)[0]
    true = stability.critical_loading(a)
    reading = "no curve at all" if np.isnan(curve) else f"Φcr(0.3) = {curve:.3g} for {true:.3g} with the printed (17)"
    return [
        Row("E15", "(17)", "denominator 2α² + Φα − 1", "αΦ − 1 with Φ = 2α + A (numerator and denominator of one Φ)",
            f"τ = {as_printed:.4f} for {right:.4f} at α = 0.3, A = 2: {_percent(as_printed / right - 1)}; {reading}"),
        Row("E16", "(17)", "+ nπ inside the arctangent", "outside: [atan2(w_d Φ, αΦ − 1) + jπ]/w_d",
            f"τ = {inside:.3g} for {right + np.pi / w:.3g} (j = 1, same place)"),
        Row("E17", "(17)", "Φc = w (Δμs − va)", "w (Δμs − Δμk va)",
            f"{_percent(off)}; at 5 mm/s {step - va:.2g} w for {step - delta * va:.2g} w, the wrong sign"),
        Row("E18", "(18)", "ξv(τoc) = 0", "ξv = 1: the mass only just comes to rest",
            f"no solution: |ξv(τoc)| is at least {least:.2g} up to α = 0.3, and 1 on the true limit"),
        Row("E19", "text", "steady state of (2), (3), (4), (8)", "of (1), (2), (5), (6)", "none"),
    ]  # fmt: skip


def _sliding(known: Known) -> list[Row]:
    g = groups(*arguments(known.values))
    slow, true = (float(stability.critical_friction(g.zeta, g.tau_cr, form)) for form in ("printed", "derived"))
    return [
        Row("E20", "(21)", "α, Δβ not those of (9a)", "Δμs w for α, Δμk/Δμs for Δβ",
            f"{g.loading:.4g} for α = {g.alpha:.3g}"),
        Row("E21", "(21)", "2ζ alone", "z = 2ζ + w Δμk va e^−va (1 − γ0): the slope of μk too",
            f"z = {g.z:.3g} for {2 * g.zeta:.3g}: {_percent(g.z / (2 * g.zeta) - 1)} less damping"),
        Row("E22", "(22)", "dots lost: δγs = …, v_acr δξ", "δγs' = −(δγs + v_acr δξ')/τcr",
            "as it stands ageing has no time of its own: no third root"),
        Row("E23", "(24)", "φ² + ζφ + 1", "φ² + 2ζφ + 1 (and “= 0”, and the factor 1 − Δβ(…) of (21))",
            "half of the damping; see E25"),
        Row("E24", "(25)", "two roots imaginary for damped oscillations", "only at the limit; there φ1 = −(2ζ + 1/τcr),"
            " Ωc = 1/√(1 + 2ζτcr)", f"Ωc = {stability.critical_frequency(g.zeta, g.tau_cr):.3g} for "
            f"{stability.critical_frequency(g.zeta, g.tau_cr, 'printed'):.3g}"),
        Row("E25", "(25)", "Πfc = (ζ²τcr + ζ(1 + τcr²))/(1 + ζτcr)", "Πfc = z (1 + τcr²/(1 + zτcr)), z = 2ζ",
            f"{slow:.3g} for {true:.3g}: {_percent(slow / true - 1)} too low; up to a factor 2 for small ζ"),
        Row("E26", "(24), (25), (9c), Figure 1", "numbers used twice", "—", "none"),
    ]  # fmt: skip


HEAD = """# Printed errors of the paper

Each error of “The stick-slip phenomenon occurring between human skin and other surfaces”, the form that follows from a
consistent model, and how much the difference amounts to. Sizes are calculated at the paper's test (1 N, 0.1 mm/min,
1470 N/m, D 37.4 µm, t_cr 0.5 s). What the paper does not state is that of a simulated pair that stands in for the one
it measured ({values}).
Written by `experiments/run_paper_figures.py`, which draws the figures below.

| | equation | printed | derived | size of the difference |
| --- | --- | --- | --- | --- |
"""

FIGURES = {
    "figure_2": "Force against time (fig. 2). Left the printed closed forms with constant kinetic friction: the only "
    "case in which they hold at any speed. Right the full law, in which friction falls with speed: the drop is more "
    "than half as large again and depends on the mass, which the paper does not state.",
    "figure_3": "Phase plane of the slip without damping (fig. 3). The printed M makes the slip too long, by a share "
    "that grows with the mass.",
    "figure_4": "Amplitude (fig. 4). The printed arctangent leaves its branch for A < −α and has no value for "
    "|α| ≥ 1. At the paper's test the overshoot is in the thousands and both forms agree.",
    "figure_5": "Loading parameter (fig. 5). The printed condition has no root; with velocity 1 the printed time gives "
    "a curve that is close by, not the same. The paper's test lies far above the limit: it sticks and slips. Where "
    "α ≤ −1 the linear law runs away and the answer comes from the nonlinear model.",
    "figure_6": "Critical friction parameter (fig. 6). The printed curve is that of half the damping: it calls sliding "
    "unstable that is stable.",
}
SHADED = (
    "Shaded: the range of the paper's test over mass (50 to 500 g), damping ratio (0.01 to 0.2), μs − μk0 (0.05 to "
    "0.3) and |Δμk| a (0 to 40 s/m), none of which it states. Star: the stand-in as fitted from its four logs (mass "
    "known to 2 %, damping to 10 %), with its 95 % confidence region drawn out."
)


def page(known: Known) -> str:
    """The page as Markdown."""
    values = ", ".join(
        f"{name} {known.values[key]:.4g}{unit}"
        for name, key, unit in (
            ("mass", "mass", " kg"),
            ("h", "damping", " N/m"),
            ("μs", "mu_s", ""),
            ("μk0", "mu_k0", ""),
            ("Δμk", "delta_mu_k", ""),
            ("a", "a", " s/m"),
        )
    )
    table = "\n".join(
        f"| {r.number} | {r.equation} | {r.printed} | {r.derived} | {r.size} |".replace("|ξv(τoc)|", "\\|ξv(τoc)\\|")
        for r in rows(known)
    )
    pictures = "\n\n".join(f"![{text.split(' (')[0]}](paper/{name}.png)\n\n{text}" for name, text in FIGURES.items())
    return f"{HEAD.format(values=values)}{table}\n\n## The figures, printed and derived\n\n{SHADED}\n\n{pictures}\n"
