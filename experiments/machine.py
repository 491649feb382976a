"""Where a measurement was made, machine, versions, commit, and by which clock."""

from __future__ import annotations

import importlib.metadata
import os
import platform
import re
import subprocess
import time
from pathlib import Path
from types import SimpleNamespace

from identify.base import budget

PACKAGES = ("casadi", "numpy", "scipy")


def describe() -> str:
    """One line: processor, cores, load, Python and package versions, commit."""
    listed = Path("/proc/cpuinfo").read_text("utf-8") if Path("/proc/cpuinfo").exists() else ""
    processor = next(re.finditer(r"model name\s*: (.*)", listed), [platform.machine()] * 2)[1]
    versions = ", ".join(f"{name} {importlib.metadata.version(name)}" for name in PACKAGES)
    load = f", load {os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else ""
    described = ["git", "-C", str(Path(__file__).parent), "describe", "--always", "--dirty"]
    commit = subprocess.run(described, capture_output=True, text=True, timeout=10, check=False).stdout.strip()
    return (
        f"{processor}, {os.cpu_count()} cores{load}; {platform.system()}, Python {platform.python_version()}, "
        f"{versions}; commit {commit or 'unknown'}"
    )


def by_processor_time() -> None:
    """Time limits of fits count processor time from here on: cases of one study get the same on a busy machine."""
    budget.time = SimpleNamespace(perf_counter=time.process_time)  # type: ignore[assignment]
    if abs(budget.now() - time.process_time()) > 1.0:
        raise RuntimeError("the clock of the limits is another one than the one that was set")
