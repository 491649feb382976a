"""Everything a command reads at run time is in the wheel: what the package data leave out is missing once installed."""

from __future__ import annotations

import os
import subprocess
import sys
import tomllib
from fnmatch import fnmatch
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PATTERNS = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["setuptools"]["package-data"]
SHIPPED = [
    path.relative_to(ROOT)
    for package in ("identify", "data_io")
    for path in sorted((ROOT / package).rglob("*"))
    if path.is_file() and path.suffix not in (".py", ".pyc") and "__pycache__" not in path.parts
]


def packed(path: Path, patterns: dict[str, list[str]]) -> bool:
    """Whether the package data take a file in, for every package or for its own."""
    package = next(p for p in path.parents if (ROOT / p / "__init__.py").exists())
    inside = path.relative_to(package)
    named = patterns.get(".".join(package.parts), [])
    return any(fnmatch(path.name, pattern) for pattern in patterns["*"]) or any(inside.match(p) for p in named)


def test_the_package_data_hold_every_file_that_is_no_module() -> None:
    assert len(SHIPPED) > 20 and [path for path in SHIPPED if not packed(path, PATTERNS)] == []


@pytest.mark.parametrize("way", [("-c", "from identify import fit"), ("-m", "identify", "inspect", "log.csv")])
def test_a_file_beside_the_user_that_hides_data_io_is_named(tmp_path: Path, way: tuple[str, ...]) -> None:
    (tmp_path / "data_io.py").write_text("def load(path):\n    return open(path).read()\n")
    where = {**os.environ, "PYTHONPATH": os.pathsep.join(["", str(ROOT)])}
    done = subprocess.run([sys.executable, *way], cwd=tmp_path, env=where, capture_output=True, text=True, check=False)
    last = done.stderr.splitlines()[-1]
    assert f"data_io is {tmp_path / 'data_io.py'}, not the package" in last and "rename that file" in last
    assert done.returncode == (1 if way[0] == "-c" else 2)
