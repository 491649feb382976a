"""`stickslip verify`: run a stored fit again from its recorded inputs and compare."""

from __future__ import annotations

import json
from argparse import ArgumentParser, Namespace
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, get_args

from identify.cli.common import DONE, NOT_SUCCEEDED, Answer, CommandLineError, Terminal

if TYPE_CHECKING:
    from identify.base.document import Json
    from identify.base.result import Result

NAME = "verify"
HELP = "run a stored fit again from its recorded inputs and compare"
ALLOWED = 0.01  # difference in standard errors that other library versions may make
FIXED = 1e-9  # relative difference of what was not estimated
END = 0.01  # relative difference of the closed end of an interval of what has no standard error


def add_arguments(parser: ArgumentParser) -> None:
    """The arguments of this command."""
    parser.add_argument("result", metavar="RESULT.json", help="the result.json of an earlier fit")
    parser.add_argument("logs", nargs="*", metavar="LOG", help="where logs of that fit lie now, if they were moved")


def run(arguments: Namespace, terminal: Terminal) -> Answer:
    """Fit again and compare status and values; exit code 3 where they differ.

    Raises:
        CommandLineError, SceneError, LogError: the result or its inputs are not there as they were.
    """
    from data_io.contents import digest_of
    from identify.cli.progress import Progress
    from identify.estimation.starts import Sources
    from identify.identification import fit
    from identify.report.stored_result import read_result, scene_of
    from identify.shooting.accuracy import FitOptions

    path = Path(arguments.result)
    stored = read_result(path)
    scene = scene_of(stored, path)
    check_unedited(path)
    moved = {digest_of(there(Path(log))): Path(log) for log in arguments.logs}
    logs = [
        replace(entry, path=unchanged(entry.path, stored.logs[stored.places(number)[0]].sha256 or "", moved))
        for number, entry in enumerate(scene.logs)
    ]
    made = stored.provenance
    seed, starts = made.get("seed"), made.get("starts")
    with Progress(terminal.notes, terminal.progress) as progress:
        found = fit(
            replace(scene, logs=tuple(logs)),
            progress=progress,
            starts=next((known for known in get_args(Sources) if known == starts), None),
            seed=seed if isinstance(seed, int) else 0,
            asked=FitOptions.again(made.get("asked")),
        )
    again = found.typed
    for words in other_versions(made, again.provenance):
        terminal.note(words)
    differences = compare(stored, again)
    for words in differences:
        terminal.say(words)
    if not differences:
        terminal.say(
            f"reproduced: {stored.status}; every value that has a standard error within {ALLOWED} of it, verdicts and "
            "open ends of intervals the same"
        )
    status = "differs" if differences else "reproduced"
    return Answer(NOT_SUCCEEDED if differences else DONE, {"status": status, "differences": differences})


def check_unedited(path: Path) -> None:
    """Refuse a result of a batch that is not, byte for byte, what the batch wrote.

    Raises:
        CommandLineError: it was edited.
    """
    from data_io.source import file_sha256

    try:
        job = json.loads((path.parent / "job.json").read_text(encoding="utf-8"))
        written = job["result_sha256"]
    except (OSError, ValueError, KeyError, TypeError, RecursionError):  # not of a batch
        return
    if path.name == "result.json" and file_sha256(path) != written:
        raise CommandLineError(f"{path}: the file was changed since the batch wrote it; run the batch with --resume")


def unchanged(path: Path, sha256: str, moved: Mapping[str, Path]) -> Path:
    """Where the very log that was fitted lies: among those named, else where it lay.

    Args:
        moved: the logs named on the command line, by SHA-256.

    Raises:
        CommandLineError: gone or changed.
    """
    from data_io.contents import digest_of, log_is_at

    if sha256 in moved:
        return moved[sha256]
    if not log_is_at(path):
        raise CommandLineError(f"{path}: the log of this result is no longer there; put it back, or name it as LOG")
    if digest_of(path) != sha256:
        raise CommandLineError(f"{path}: the log has changed since that fit (other SHA-256); put the old one back")
    return path


def there(path: Path) -> Path:
    """The path of a log that is there.

    Raises:
        CommandLineError: it is not.
    """
    from data_io.contents import log_is_at

    if not log_is_at(path):
        raise CommandLineError(f"{path}: there is no log; give a file, a folder of them, or a pattern in quotes")
    return path


def other_versions(before: Mapping[str, Json], now: Mapping[str, Json]) -> Sequence[str]:
    """What the result was made with, where that was something else, one sentence each."""
    packages = [found if isinstance(found := made.get("packages"), Mapping) else {} for made in (before, now)]
    told, here = ({"stickslip": made.get("version"), **own} for made, own in zip((before, now), packages, strict=True))
    return [f"made with {n} {told[n]}, compared with {v}" for n, v in here.items() if told.get(n) not in (None, v)]


def compare(stored: Result, again: Result) -> list[str]:
    """What differs, one sentence each: verdicts, values by their standard errors, ends of intervals without one."""
    if stored.status != again.status:
        return [f"the status was {stored.status} and is {again.status} now: {again.message}"]
    sentences = [f"{name} is new" for name in again.parameters if name not in stored.parameters]
    for name, before in stored.parameters.items():
        now = again.parameters.get(name)
        if now is None or before.verdict != now.verdict:
            sentences.append(f"{name} was called {before.verdict} and is called {now.verdict if now else None} now")
            continue
        allowed = ALLOWED * before.standard_error if before.standard_error else FIXED * abs(before.value or 0.0)
        numbers = [("", before.value, now.value, allowed)]
        if not before.standard_error and before.verdict != "fixed":  # its value may be anywhere between its ends
            ends = zip(("the lower end of ", "the upper end of "), before.ends, now.ends, strict=True)
            numbers = [(word, old, new, END * abs(old or 0.0)) for word, old, new in ends]
        for word, old, new, most in numbers:
            if (old is None) != (new is None) or (old is not None and new is not None and abs(new - old) > most):
                was, is_ = ("open" if number is None else f"{number:.9g}" for number in (old, new))
                sentences.append(f"{word}{name} was {was} and is {is_} now")
    return sentences
