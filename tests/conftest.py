"""Tests run in CasADi's virtual machine and leave no machine code behind; tests of machine code ask for it."""

import os

os.environ.setdefault("STICKSLIP_COMPILE", "0")

from collections.abc import Iterator
from pathlib import Path

import pytest

from identify.numerics import native


@pytest.fixture
def machine_code(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Functions are compiled here, into a cache of its own."""
    monkeypatch.setenv("STICKSLIP_COMPILE", "1")
    monkeypatch.setenv("STICKSLIP_CACHE", str(tmp_path / "cache"))
    known = (native.compiler, native.folder, native._translator)
    for function in known:
        function.cache_clear()
    if native.compiler() is None:
        pytest.skip("no C compiler here")
    yield tmp_path / "cache"
    native.wait()
    for function in known:
        function.cache_clear()
