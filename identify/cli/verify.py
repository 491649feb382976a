"""`stickslip verify`: run a stored fit again from its recorded inputs and compare."""

from __future__ import annotations

import hashlib
from argparse import ArgumentParser, Namespace
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from identify.cli.common import DONE, NOT_SUCCEEDED, Answer, CommandLineError, Terminal
from identify.cli.results import read_result, scene_of

NAME = "verify"
HELP = "run a stored fit again from its recorded inputs and compare"
ALLOWED = 0.01  # difference in standard errors that other library versions may make


def add_arguments(parser: ArgumentParser) -> None:
    """The arguments of this command."""
    parser.add_argument("result", metavar="RESULT.json", help="the result.json of an earlier fit")


def run(arguments: Namespace, terminal: Terminal) -> Answer:
    """Fit again and compare status and values; exit code 3 where they differ.

    Raises:
        CommandLineError, SceneError, LogError: the result or its inputs are not there as they were.
    """
    path = Path(arguments.result)
    stored = read_result(path)

    from identify.cli.progress import Progress
    from identify.identification import fit

    scene = scene_of(stored, path)
    for entry, log in zip(scene.logs, stored["logs"], strict=True):
        check_unchanged(entry.path, log["sha256"])
    with Progress(terminal.notes) as progress:
        again = fit(scene, progress=progress).result
    differences = compare(stored, again)
    for words in differences:
        terminal.say(words)
    if not differences:
        terminal.say(f"reproduced: {again['status']}, every value within {ALLOWED} standard errors")
    status = "differs" if differences else "reproduced"
    return Answer(NOT_SUCCEEDED if differences else DONE, {"status": status, "differences": differences})


def check_unchanged(path: Path, sha256: str) -> None:
    """Refuse a log that is not the one that was fitted.

    Raises:
        CommandLineError: gone or changed.
    """
    if not path.is_file():
        raise CommandLineError(f"{path}: the log of this result is no longer there; put it back")
    if hashlib.sha256(path.read_bytes()).hexdigest() != sha256:
        raise CommandLineError(f"{path}: the log has changed since that fit (other SHA-256); put the old one back")


def compare(stored: Mapping[str, Any], again: Mapping[str, Any]) -> list[str]:
    """What differs, one sentence each."""
    if stored["status"] != again["status"]:
        return [f"the status was {stored['status']} and is {again['status']} now: {again['message']}"]
    sentences = []
    for name, before in stored["parameters"].items():
        now = again["parameters"].get(name, {})
        if before["verdict"] != now.get("verdict"):
            sentences.append(f"{name} was called {before['verdict']} and is called {now.get('verdict')} now")
        elif before["value"] is not None and before["standard_error"]:
            off = (now["value"] - before["value"]) / before["standard_error"]
            if abs(off) > ALLOWED:
                sentences.append(
                    f"{name} was {before['value']:.6g} and is {now['value']:.6g} ({off:+.2g} standard errors)"
                )
    return sentences
