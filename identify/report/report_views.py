"""What the template of the page shows, as plain values: banner, parameters, logs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from data_io.correct import Change
from identify.base.outcome import Status
from identify.base.result import Interval, LogResult, ParameterResult, Result
from identify.base.wording import DASH, decimals, ends_text, number, places_for, quantity, scale_for, speed
from identify.prediction.wording import listed
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
from identify.report.shown_error import said_once, scatter, shown_error
from identify.report.uneven_words import DRAWN, NOT_FOR, distribution_lines, is_uneven, odd_slips
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
    exact: str = ""  # the interval of noise alone


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


def banner(result: Result) -> Banner:
    """The answer to "can it be trusted?" in plain words."""
    words = STATUS[Status(result.status)]
    if is_uneven(result):
        rests_on = result.message.split("; ")[0]
        message = f"{rests_on[0].upper()}{rests_on[1:]}. {NOT_FOR} {DRAWN} {odd_slips(result)}".strip()
        return Banner("fair", "described cycle by cycle", headline_of(result), message, _tiles(result))
    kind, headline = ("good", words.headline) if result.converged else ("bad", words.headline)
    doubtful = [name for name, entry in result.parameters.items() if entry.verdict in ("not identifiable", "at bound")]
    if result.converged and doubtful:
        kind = "fair"
        headline += f" These logs do not tell {listed([plain_symbol(n) for n in doubtful])}."
    return Banner(kind, words.badge, headline, result.message, _tiles(result))


def parameter_views(parameters: Mapping[str, ParameterResult]) -> tuple[ParameterView, ...]:
    """The rows of the parameter table."""
    views = [_parameter(name, entry) for name, entry in parameters.items()]
    reasons = said_once([view.reason for view in views])
    return tuple(replace(view, reason=reason) for view, reason in zip(views, reasons, strict=True))


def log_views(result: Result) -> tuple[LogView, ...]:
    """One view per log of the result."""
    return tuple(_log(number_, log, result.converged) for number_, log in enumerate(result.logs, start=1))


def _parameter(name: str, entry: ParameterResult) -> ParameterView:
    value, error, scattered = entry.value, shown_error(entry), scatter(entry)
    scale = scale_for(value, entry.unit)
    shown = None if value is None else value / scale.factor
    places = places_for(scattered / scale.factor, shown) if scattered else places_for(None, shown) - 1
    own = entry.parameter or name
    symbol, subscript = SYMBOLS.get(own, (name, ""))
    return ParameterView(
        symbol=symbol,
        subscript=subscript,
        name=with_group(name, entry.group),
        group=entry.group,
        meaning=MEANINGS.get(own, ""),
        value=DASH if shown is None else decimals(shown, places),
        error="" if error is None else decimals(error / scale.factor, places),
        unit=scale.unit,
        interval=DASH
        if entry.verdict == "fixed" or not entry.interval
        else _interval(entry.ends, scale.factor, places),
        si=f"{number(value, 5)} {entry.unit}" if value is not None and scale.factor != 1 else "",
        verdict=entry.verdict,
        verdict_class=VERDICT_CLASS.get(entry.verdict, "plain"),
        verdict_mark=VERDICT_MARK.get(entry.verdict, ""),
        reason=entry.reason,
        bare=error is None and scattered is not None,
        exact=_exact(entry, shown, scale.factor),
    )


def _exact(entry: ParameterResult, shown: float | None, factor: float) -> str:
    """The interval of noise alone, with as many decimals as that one is worth."""
    interval = entry.interval_rig_exact
    if interval is None or shown is None:
        return ""
    ends = [abs(end / factor - shown) for end in interval if end is not None]
    return _interval(interval, factor, places_for(min(ends, default=0.0) / 2, shown))


def _interval(interval: Interval | None, factor: float, places: int) -> str:
    if interval is None:
        return DASH
    low, high = interval
    if low is None and high is None:
        return "open"
    if low is None:
        return f"below {decimals((high or 0.0) / factor, places)}"
    if high is None:
        return f"above {decimals(low / factor, places)}"
    return ends_text(low / factor, high / factor, places)


def _tiles(result: Result) -> tuple[Tile, ...]:
    gate, fit = result.gate, result.fit
    tiles = [
        Tile(name, value, f"{spread} in nine of ten drawn cycles") for name, value, spread in distribution_lines(result)
    ]
    if gate is not None:
        tiles.append(Tile("misfit", number(gate.chi2_per_sample, 4), "χ² per sample; 1 is pure noise"))
        if gate.worst_cycle is not None:
            worst = gate.worst_cycle
            where = f"log {worst.log}, cycle {worst.cycle}; a few is usual, above 6 is refused"
            tiles.append(Tile("worst cycle", f"z = {number(worst.z, 3)}", where))
        if gate.solver is not None:
            tiles.append(Tile("solver", solver_words(gate.solver), "how the optimiser ended"))
        shift = number(gate.event_shift_samples, 2)
        tiles.append(Tile("switch times", f"{shift} samples", "last movement; settled below 0.5"))
    if fit is not None:
        rms = quantity(fit.rms_N, "N", 3)
        cycles = DASH if fit.cycles is None else fit.cycles
        tiles.append(Tile("data", f"{cycles} cycles", f"{_thousands(fit.samples)} samples; residual {rms} (rms)"))
    return tuple(tiles)


def _thousands(count: int | None) -> str:
    return f"{count:,}".replace(",", "\N{NARROW NO-BREAK SPACE}") if count else DASH


def _log(number_: int, log: LogResult, converged: bool) -> LogView:
    verdict = log.quality.verdict
    return LogView(
        number=number_,
        name=log.name or f"log {number_}",
        path=log.path,
        sha256=log.sha256 or "",
        facts=_facts(log),
        labels=tuple(log.labels.items()),
        quality=QUALITY.get(verdict, verdict),
        # green beside a fit that was refused would say the opposite of the banner
        quality_class=QUALITY_CLASS.get(verdict, "plain") if converged or verdict != "accept" else "plain",
        findings=tuple((finding.severity, finding.message) for finding in log.quality.findings),
        left_out=log.reason_left_out or "",
        corrections=tuple(_correction(change) for change in log.corrections),
    )


def _correction(change: Change) -> str:
    error = change.standard_error
    return f"{change.text} (standard error {quantity(error, change.unit, 2)})" if error else change.text


def _facts(log: LogResult) -> tuple[tuple[str, str], ...]:
    facts = [
        ("drive speed", speed(log.drive_speed_m_per_s)),
        ("normal force", quantity(log.normal_force_N, "N", 3)),
        ("step", DASH if log.step is None else str(log.step)),
        ("samples", _thousands(log.rows)),
        ("slips", DASH if log.slip_count is None else str(log.slip_count)),
        ("noise", quantity(log.noise_N, "N", 2)),
    ]
    if log.friction_sign == -1:
        facts.append(("sign", "friction force turned over"))
    return tuple(fact for fact in facts if fact[1] != DASH)
