"""What the template of the page shows, as plain values: banner, parameters, logs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from identify.base.outcome import Status
from identify.prediction.wording import listed
from identify.report.quantity_text import (
    DASH,
    decimals,
    ends_text,
    finite,
    number,
    places_for,
    quantity,
    said_once,
    scale_for,
    scatter,
    shown_error,
    speed,
)
from identify.report.report_wording import (
    MEANINGS,
    QUALITY,
    QUALITY_CLASS,
    STATUS,
    SYMBOLS,
    VERDICT_CLASS,
    VERDICT_MARK,
    plain_symbol,
    solver_words,
    with_group,
)
from identify.report.uneven_words import NOT_FOR, distribution_lines, is_uneven, odd_slips
from identify.report.uneven_words import headline as headline_of


@dataclass(frozen=True)
class Tile:
    """One figure of the gate with what it should be."""

    label: str
    value: str
    meaning: str


@dataclass(frozen=True)
class Banner:
    """Can it be trusted: badge, headline, sentence, and the figures behind the answer."""

    kind: str
    badge: str
    headline: str
    message: str
    tiles: tuple[Tile, ...]


@dataclass(frozen=True)
class ParameterView:
    """One row of the parameter table, ready to print."""

    symbol: str
    subscript: str
    name: str
    group: str
    meaning: str
    value: str
    error: str
    unit: str
    interval: str
    si: str
    verdict: str
    verdict_class: str
    verdict_mark: str
    reason: str
    bare: bool = False  # an interval, and no standard error that goes with it
    practical: str = ""  # the interval with the tolerances of rig and sensors


@dataclass(frozen=True)
class LogView:
    """One log as its section shows it."""

    number: int
    name: str
    path: str
    sha256: str
    facts: tuple[tuple[str, str], ...]
    labels: tuple[tuple[str, str], ...]
    quality: str
    quality_class: str
    findings: tuple[tuple[str, str], ...]
    left_out: str
    corrections: tuple[str, ...] = ()


def banner(result: Mapping[str, Any]) -> Banner:
    """The answer to "can it be trusted?" in plain words."""
    words = STATUS[Status(result["status"])]
    converged = result["status"] == "converged"
    kind, headline = ("good", words.headline) if converged else ("bad", words.headline)
    doubtful = [
        name
        for name, entry in result.get("parameters", {}).items()
        if entry.get("verdict") in ("not identifiable", "at bound")
    ]
    if is_uneven(result):
        message = f"{NOT_FOR} {odd_slips(result)}".strip()
        return Banner("fair", "described cycle by cycle", headline_of(result), message, _tiles(result))
    if converged and doubtful:
        kind = "fair"
        headline += f" These logs do not tell {listed([plain_symbol(n) for n in doubtful])}."
    return Banner(kind, words.badge, headline, str(result.get("message", "")), _tiles(result))


def parameter_views(parameters: Mapping[str, Mapping[str, Any]]) -> tuple[ParameterView, ...]:
    """The rows of the parameter table."""
    views = [_parameter(name, entry) for name, entry in parameters.items()]
    reasons = said_once([view.reason for view in views])
    return tuple(replace(view, reason=reason) for view, reason in zip(views, reasons, strict=True))


def log_views(result: Mapping[str, Any]) -> tuple[LogView, ...]:
    """One view per log of the document."""
    converged = result["status"] == "converged"
    return tuple(_log(number_, log, converged) for number_, log in enumerate(result.get("logs", ()), start=1))


def last_iterate_rows(last: Any) -> tuple[tuple[str, str], ...]:
    """Name and number of the last iterate, where it is a mapping of numbers or of entries with a value."""
    if not isinstance(last, Mapping):
        return ()
    rows = []
    for name, entry in last.items():
        value, unit = (entry.get("value"), entry.get("unit")) if isinstance(entry, Mapping) else (entry, "")
        rows.append((str(name), quantity(finite(value), str(unit or ""))))
    return tuple(rows)


def _parameter(name: str, entry: Mapping[str, Any]) -> ParameterView:
    value, unit = finite(entry.get("value")), str(entry.get("unit") or "")
    error, scattered = shown_error(entry), scatter(entry)
    scale = scale_for(value, unit)
    shown = None if value is None else value / scale.factor
    places = places_for(scattered / scale.factor, shown) if scattered else places_for(None, shown) - 1
    symbol, subscript = entry.get("symbol") or SYMBOLS.get(str(entry.get("parameter") or name), (name, ""))
    verdict = str(entry.get("verdict") or "")
    return ParameterView(
        symbol=symbol,
        subscript=subscript,
        name=with_group(name, entry),
        group=str(entry.get("group") or ""),
        meaning=str(entry.get("meaning") or MEANINGS.get(str(entry.get("parameter") or name), "")),
        value=DASH if shown is None else decimals(shown, places),
        error="" if error is None else decimals(error / scale.factor, places),
        unit=scale.unit,
        interval=DASH if verdict == "fixed" else _interval(entry.get("interval"), scale.factor, places),
        si=f"{number(value, 5)} {unit}" if value is not None and scale.factor != 1 else "",
        verdict=verdict,
        verdict_class=VERDICT_CLASS.get(verdict, "plain"),
        verdict_mark=VERDICT_MARK.get(verdict, ""),
        reason=str(entry.get("reason") or ""),
        bare=error is None and scattered is not None,
        practical=_practical(entry, shown, scale.factor),
    )


def _practical(entry: Mapping[str, Any], shown: float | None, factor: float) -> str:
    """The interval with the tolerances, with as many decimals as that one is worth."""
    interval = entry.get("interval_with_tolerances")
    if interval is None or shown is None:
        return ""
    ends = [abs(end / factor - shown) for end in interval if finite(end) is not None]
    return _interval(interval, factor, places_for(min(ends, default=0.0) / 2, shown))


def _interval(interval: Any, factor: float, places: int) -> str:
    if not isinstance(interval, Sequence) or isinstance(interval, str) or len(interval) != 2:
        return DASH
    low, high = finite(interval[0]), finite(interval[1])
    if low is None and high is None:
        return "open"
    if low is None:
        return f"below {decimals((high or 0.0) / factor, places)}"
    if high is None:
        return f"above {decimals(low / factor, places)}"
    return ends_text(low / factor, high / factor, places)


def _tiles(result: Mapping[str, Any]) -> tuple[Tile, ...]:
    gate, fit = result.get("gate") or {}, result.get("fit") or {}
    tiles = [Tile(name, value, f"{spread} in nine of ten cycles") for name, value, spread in distribution_lines(result)]
    if "chi2_per_sample" in gate:
        tiles.append(Tile("misfit", number(finite(gate["chi2_per_sample"]), 4), "χ² per sample; 1 is pure noise"))
    worst = gate.get("worst_cycle") or {}
    if worst:
        where = f"log {worst.get('log', DASH)}, cycle {worst.get('cycle', DASH)}; a few is usual, above 6 is refused"
        tiles.append(Tile("worst cycle", f"z = {number(finite(worst.get('z')), 3)}", where))
    if gate.get("solver") is not None:
        tiles.append(Tile("solver", solver_words(str(gate["solver"])), "how the optimiser ended"))
    if "event_shift_samples" in gate:
        shift = number(finite(gate["event_shift_samples"]), 2)
        tiles.append(Tile("switch times", f"{shift} samples", "last movement; settled below 0.5"))
    if fit:
        count = (
            f"{fit.get('samples', DASH):,}".replace(",", "\N{NARROW NO-BREAK SPACE}") if fit.get("samples") else DASH
        )
        rms = quantity(finite(fit.get("rms_N")), "N", 3)
        tiles.append(Tile("data", f"{fit.get('cycles', DASH)} cycles", f"{count} samples; residual {rms} (rms)"))
    return tuple(tiles)


def _log(number_: int, log: Mapping[str, Any], converged: bool) -> LogView:
    quality = log.get("quality") or {}
    verdict = str(quality.get("verdict") or "")
    path = str(log.get("path", ""))
    return LogView(
        number=number_,
        name=path.replace("\\", "/").rsplit("/", 1)[-1] or f"log {number_}",
        path=path,
        sha256=str(log.get("sha256") or ""),
        facts=_facts(log),
        labels=tuple((str(key), str(value)) for key, value in (log.get("labels") or {}).items()),
        quality=QUALITY.get(verdict, verdict),
        # green beside a fit that was refused would say the opposite of the banner
        quality_class=QUALITY_CLASS.get(verdict, "plain") if converged or verdict != "accept" else "plain",
        findings=tuple(
            (str(f.get("severity", "info")), str(f.get("message", ""))) for f in quality.get("findings", ())
        ),
        left_out=str(log.get("reason_left_out") or ""),
        corrections=tuple(_correction(change) for change in log.get("corrections") or ()),
    )


def _correction(change: Mapping[str, Any]) -> str:
    error = finite(change.get("standard_error"))
    spread = f" (standard error {quantity(error, str(change.get('unit') or ''), 2)})" if error else ""
    return f"{change.get('text', '')}{spread}"


def _facts(log: Mapping[str, Any]) -> tuple[tuple[str, str], ...]:
    facts = [
        ("drive speed", speed(finite(log.get("drive_speed_m_per_s")))),
        ("normal force", quantity(finite(log.get("normal_force_N")), "N", 3)),
        ("step", DASH if log.get("step") is None else str(log["step"])),
        ("samples", DASH if log.get("rows") is None else f"{log['rows']:,}".replace(",", "\N{NARROW NO-BREAK SPACE}")),
        ("slips", DASH if log.get("slip_count") is None else str(log["slip_count"])),
        ("noise", quantity(finite(log.get("noise_N")), "N", 2)),
    ]
    if log.get("friction_sign") == -1:
        facts.append(("sign", "friction force turned over"))
    return tuple(fact for fact in facts if fact[1] != DASH)
