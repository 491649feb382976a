"""Folder names for groups, whatever the groups are called."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Sequence

LONGEST = 80  # characters
# What a batch itself writes, and what Windows keeps for itself: no folder may be called so.
_PORTS = [f"{port}{i}" for port in ("com", "lpt") for i in range(1, 10)]
TAKEN = frozenset(["batch.json", "index.csv", "report.html", "con", "prn", "aux", "nul", *_PORTS])
_HARMFUL = re.compile(r"[^\w.+=@()\[\] -]+")


def folder_names(groups: Sequence[str]) -> dict[str, str]:
    """A folder name for each group: its own where that is harmless and unlike all others, else with a hash behind."""
    plain = {group: _harmless(group) for group in groups}
    folded = [name.casefold() for name in plain.values()]
    return {
        group: name if name == group and folded.count(name.casefold()) == 1 else f"{name}-{_hash(group)}"
        for group, name in plain.items()
    }


def _harmless(group: str) -> str:
    """Word characters and a few signs; no leading or trailing dot, no name that is taken, not too long."""
    name = _HARMFUL.sub("_", group).strip("._- ")
    while len(name.encode()) > LONGEST:
        name = name[: len(name) - 1 - max(0, (len(name) - LONGEST))]
    if not name or name.split(".")[0].casefold() in TAKEN or name.casefold() in TAKEN:
        name = f"group_{name}".rstrip("_")
    return name


def _hash(group: str) -> str:
    return hashlib.sha256(group.encode("utf-8", "surrogatepass")).hexdigest()[:8]
