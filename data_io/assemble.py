"""Steps to a `Record`: one clock, one sign of the normal force, and the account of where everything came from."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, cast

import numpy as np

from data_io.arrays import thinned
from data_io.clock import StepClock, joined
from data_io.contents import Contents, Part, check_request, chosen, of_run
from data_io.convert import SiStep, Span, convert, origin, unused_spans, without_marks, without_needless
from data_io.record import WINDOW_START, Record
from data_io.source import Request, Source, sha256_unchanged
from data_io.units import rescaled
from data_io.values import COLUMN_ROLES, Finding, FloatArray, Later, Scalar, Step


def assemble(
    source: Source,
    request: Request,
    contents: Contents,
) -> Record:
    """Build the record of the chosen step or of all steps of a run. Raises `LogError`.

    Unless the format is ours, the sign of the normal force is taken from the loaded rows of the whole run, and empty
    columns are left out.
    """
    settled = contents.settled
    run = of_run(source, request, contents.parts)
    check_request(source, request, run[0].header)
    cleaned = [without_marks(part) for part in run]
    run = [part for part, _ in cleaned]
    picked = chosen(source, request, run)
    notes = [*contents.findings, *(note for part, found in cleaned if part in picked for note in found)]
    pulls = not settled and request.normal_force is None and _pressed_negative(run)
    steps: list[SiStep] = []
    begin = contents.skipped if len(picked) == 1 else None
    for part in picked:
        step, remarks = convert(source, request, part, several=len(run) > 1, settled=settled, begin=begin)
        steps.append(step)
        notes += remarks
    clocks = [StepClock(step.label, step.time, part.started) for step, part in zip(steps, picked, strict=True)]
    offsets, remarks = joined(clocks)
    notes += remarks
    start = float(steps[0].time[0])
    shifts = [offset - start if offset else -start for offset in offsets]
    normal = _one([rescaled(step.roles["normal_force"], -1.0 if pulls else 1.0) for step in steps])
    if pulls:
        message = "the file has the normal force negative in compression; its sign was turned, compression is positive"
        notes.append(Finding("normal_force_flipped", "info", message))
    channels, units = _channels(steps)
    along = all("drive_speed" in step.roles for step in steps)
    ends = np.cumsum([step.time.size for step in steps]).tolist()
    values: dict[str, Any] = {
        "time": _one([_shifted(step.time, shift) for step, shift in zip(steps, shifts, strict=True)]),
        "normal_force": normal,
        "friction_force": _one([step.roles["friction_force"] for step in steps]),
        "drive_speed": _one([step.roles["drive_speed"] for step in steps]) if along else contents.drive_speed,
        "channels": channels,
        "steps": tuple(
            Step(part.run, part.number, end - step.time.size, end, part.parameters)
            for part, step, end in zip(picked, steps, ends, strict=True)
        ),
    }
    if spans := unused_spans(request):
        values = _without_needless(values, spans, contents.skipped)
    metadata = _account(source, request, picked[0], contents, start)
    return Record(**values, channel_units=units, metadata=metadata, findings=tuple(dict.fromkeys(notes)))


def _without_needless(values: dict[str, Any], spans: Sequence[Span], begin: float) -> dict[str, Any]:
    """Return the columns without the rows that hold no force in stretches that nobody uses; begin: of the first row."""
    bad = ~(np.isfinite(values["normal_force"]) & np.isfinite(values["friction_force"]))
    if not bad.any():
        return values
    keep = without_needless(values["time"] + begin, bad, spans, ends=True)
    rows = np.concatenate(([0], np.cumsum(keep)))
    steps = [replace(s, start=int(rows[s.start]), stop=int(rows[s.stop])) for s in values["steps"]]
    drive = values["drive_speed"]
    return {
        **{name: values[name][keep] for name in COLUMN_ROLES[:3]},
        "drive_speed": drive[keep] if isinstance(drive, np.ndarray) else drive,
        "channels": {name: column[keep] for name, column in values["channels"].items()},
        "steps": tuple(step for step in steps if step.stop > step.start),
    }


def _one(pieces: Sequence[FloatArray]) -> FloatArray:
    """Join columns that nobody else holds, and freeze them, so that the record need not copy them."""
    joined = pieces[0] if len(pieces) == 1 else np.concatenate(pieces)
    base: Any = joined
    while isinstance(base, np.ndarray):
        base.flags.writeable = False
        base = base.base
    return joined


def _shifted(time: FloatArray, shift: float) -> FloatArray:
    """Return a time that nobody else holds, moved."""
    if shift == 0:
        return time
    return np.add(time, shift, out=time if time.flags.writeable else None)


def _account(source: Source, request: Request, part: Part, contents: Contents, start: float) -> dict[str, Scalar]:
    about: dict[str, Scalar] = {f"{role}_source": origin(request, part, role) for role in COLUMN_ROLES[:3]}
    about |= {**contents.metadata, **part.run_items}
    path, size = source.path, source.size  # and nothing else of the source is kept
    about |= {
        "path": str(path),
        "sha256": cast(str, Later(lambda: sha256_unchanged(path, size))),
        "format": contents.form,
    }
    about.pop(WINDOW_START, None)  # of the log that the file was made from
    if contents.skipped:
        about[WINDOW_START] = contents.skipped
    if start != 0:
        about["file_time_start"] = start + float(contents.metadata.get("file_time_start", 0.0))
    return about


def _pressed_negative(run: Sequence[Part]) -> bool:
    """Tell whether the loaded rows of a run press with a negative sign; a small offset before loading says nothing."""
    pieces = [part.columns[part.header.roles["normal_force"]] for part in run
              if part.rows and part.header.roles.get("normal_force") in part.columns]  # fmt: skip
    raw = thinned(pieces[0] if len(pieces) == 1 else np.concatenate(pieces or [np.empty(0)]))
    raw = raw[np.isfinite(raw)]
    if np.min(raw, initial=0.0) >= 0:
        return False
    size = np.abs(raw)
    return bool(np.median(raw[size >= 0.5 * np.quantile(size, 0.99)]) < 0)


def _channels(steps: Sequence[SiStep]) -> tuple[dict[str, FloatArray], dict[str, str]]:
    """Join the channels of all steps; a step without a channel holds NaN there, another unit makes another channel."""
    units: dict[str, str] = {}
    for step in steps:
        for name, (_, unit) in step.channels.items():
            units.setdefault(name, unit)
    columns: dict[str, FloatArray] = {}
    for name, unit in units.items():
        pieces = []
        for step in steps:
            values, own = step.channels.get(name, (None, unit))
            pieces.append(values if values is not None and own == unit else np.full(step.time.size, np.nan))
        columns[name] = _one(pieces)
    return columns, units
