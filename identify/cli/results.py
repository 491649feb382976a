"""Reading the result.json of an earlier fit."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from identify.cli.common import CommandLineError


def read_result(path: Path) -> dict[str, Any]:
    """The document of a stored result.

    Raises:
        CommandLineError: no such file, or no result of ours.
    """
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise CommandLineError(f"{path}: no such file; give the result.json of a fit") from None
    except ValueError:
        raise CommandLineError(f"{path}: this is not JSON; give the result.json of a fit") from None
    if not isinstance(document, dict) or not {"status", "parameters", "logs", "provenance"} <= set(document):
        raise CommandLineError(f"{path}: this is no result of a fit; give a result.json that stickslip fit wrote")
    return document
