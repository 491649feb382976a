"""The JSON account in our own files of what is no column: read back with every value of the kind it must be."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from data_io.frozen import SEVERITIES, Finding, Scalar, Step


@dataclass(frozen=True)
class Account:
    """Metadata and findings; steps and a constant drive speed [m/s] where the file keeps them in the account."""

    metadata: Mapping[str, Scalar]
    findings: Sequence[Finding] = ()
    steps: Sequence[Step] = ()
    drive_speed: float | None = None


def read_account(text: str) -> Account:
    """Read the JSON that `write` makes. Raises `ValueError` for anything else."""
    try:
        about: dict[str, Any] = json.loads(text)
        metadata = dict(about["metadata"])
        findings = [Finding(*finding) for finding in about["findings"]]
        steps = [Step(*step) for step in about.get("steps", ())]
        speed = about.get("drive_speed")
        float(metadata.get("file_time_start", 0.0))
        sound = (
            all(isinstance(value, (str, int, float)) for value in metadata.values())
            and all(isinstance(f.message, str) and f.severity in SEVERITIES for f in findings)
            and all(isinstance(n, int) for s in steps for n in (s.run, s.number, s.start, s.stop))
        )
        account = Account(metadata, findings, steps, None if speed is None else float(speed))
    except (ValueError, LookupError, TypeError, AttributeError, OverflowError, RecursionError) as error:
        raise ValueError("not the JSON account of a log") from error
    if not sound:
        raise ValueError("a value of the wrong kind in the JSON account of a log")
    return account
