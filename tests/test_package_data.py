"""Everything a command reads at run time is in the wheel: what the package data leave out is missing once installed."""

from __future__ import annotations

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


@pytest.mark.parametrize("path", SHIPPED, ids=str)
def test_the_package_data_hold_every_file_that_is_no_module(path: Path) -> None:
    assert packed(path, PATTERNS)
