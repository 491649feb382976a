"""The closed forms once more, in 60 digits and by the plainest formulas: what the package's are compared with."""

from __future__ import annotations

from typing import Any

import mpmath as mp

mp.mp.dps = 60
HALVINGS, NEWTON = 230, 6


def maximum(alpha: Any, overshoot: Any) -> tuple[Any, Any] | None:
    """(time, ln amplitude) of the elongation maximum; None where there is none."""
    a, A = mp.mpf(alpha), mp.mpf(overshoot)
    square, s = (1 - a) * (1 + a), a + A
    if square > 0:
        tau = mp.atan2(mp.sqrt(square), s) / mp.sqrt(square)
    elif square == 0:
        if s <= 0:
            return None
        tau = 1 / s
    else:
        root = mp.sqrt(-square)
        if s <= root:
            return None
        tau = mp.log((s + root) / (s - root)) / (2 * root)
    return tau, mp.log(square + s * s) / 2 - a * tau


def gap(alpha: Any, overshoot: Any, eps: Any) -> Any:
    """exp(alpha tau) (1 - velocity) at the angle eps = 2 pi - w_d tau."""
    w = mp.sqrt((1 - alpha) * (1 + alpha))
    return 1 - mp.cos(eps) - (alpha + overshoot) / w * mp.sin(eps) + mp.expm1(alpha / w * (2 * mp.pi - eps))


def status(alpha: Any, overshoot: Any) -> str:
    """What becomes of the slip."""
    a, A = mp.mpf(alpha), mp.mpf(overshoot)
    phi = 2 * a + A
    if phi < 0:
        return "no_slip"
    if a <= -1 or a >= 1:
        return "runaway" if a <= -1 else "steady"
    return "steady" if a > 0 and gap(a, A, _first(a, phi)) > 0 else "restick"


def _first(a: Any, phi: Any) -> Any:
    return mp.atan2(mp.sqrt((1 - a) * (1 + a)) * phi, 1 - a * phi)


def slip(alpha: Any, overshoot: Any, near: Any = None) -> dict[str, Any]:
    """Every number of a slip that sticks again, and the angle `eps` it ends at (a guess of it saves the
    halvings)."""
    a, A = mp.mpf(alpha), mp.mpf(overshoot)
    w, phi = mp.sqrt((1 - a) * (1 + a)), 2 * a + A
    if near is None:
        low, high = _first(a, phi), _first(a, phi) + mp.pi
        for _ in range(HALVINGS):
            middle = (low + high) / 2
            low, high = (middle, high) if gap(a, A, middle) <= 0 else (low, middle)
        eps = (low + high) / 2
    else:
        eps = mp.mpf(near)
        for _ in range(NEWTON):
            slope = mp.sin(eps) - (a + A) / w * mp.cos(eps) - a / w * mp.exp(a / w * (2 * mp.pi - eps))
            eps -= gap(a, A, eps) / slope
    tau = (2 * mp.pi - eps) / w
    stop = mp.exp(-a * tau) * (-phi * mp.cos(eps) + (1 - a * phi) * mp.sin(eps) / w)
    peak = mp.atan2(w * phi, a * phi - 1) / w
    swing = mp.sqrt((a + A) ** 2 + w * w)
    height = swing * mp.exp(-a * mp.atan2(w, a + A) / w)
    return {
        "eps": eps,
        "duration": tau,
        "elongation": -(2 * a + stop),
        "acceleration": stop,
        "drop": phi + stop,
        "period": tau + phi + stop,
        "peak_to_peak": height * (1 + mp.exp(-a * mp.pi / w)),
        "time_of_peak_speed": peak,
        "peak_speed": 1 + swing * mp.exp(-a * peak),
    }
