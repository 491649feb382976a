"""Tests run in CasADi's virtual machine and leave no machine code behind; tests of machine code ask for it.

Those marked slow take 3 to 50 s each, most of them whole fits of hard cases: they run with --slow.
"""

import gc
import os
import sys

os.environ.setdefault("STICKSLIP_COMPILE", "0")
os.environ.setdefault("OMP_NUM_THREADS", "1")  # before numpy: its threads wait for each other beside xdist
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import time
import weakref
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest

from identify.base import budget, compiled, native
from identify.report import result
from identify.uneven.slip_functions import slip_functions


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--slow", action="store_true", help="also the tests that take 3 to 50 s each")


def pytest_configure() -> None:
    """Test files, and what tests start, are compiled once, also where the shell asks to keep no bytecode."""
    sys.dont_write_bytecode = False
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Iterator[None]:
    """Modules and collected tests stay to the end: the garbage collector would walk them for a thirtieth of the run."""
    gc.disable()
    yield
    gc.freeze()
    gc.enable()


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Readers first: an HDF5 file is looked at in a copy of the process, which costs the more the more that holds."""
    items.sort(key=lambda item: item.path.parent.name != "data_io")
    if not config.getoption("--slow"):
        for item in items:
            if item.get_closest_marker("slow"):
                item.add_marker(pytest.mark.skip(reason="takes 3 s and more: run with --slow"))


@pytest.fixture(autouse=True)
def limits_in_processor_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """A busy machine changes no verdict: time limits of fits count processor time here."""
    monkeypatch.setattr(budget, "time", SimpleNamespace(perf_counter=time.process_time))


@pytest.fixture
def machine_code(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Functions are compiled here, into a cache of its own."""
    monkeypatch.setenv("STICKSLIP_COMPILE", "1")
    monkeypatch.setenv("STICKSLIP_CACHE", str(tmp_path / "cache"))
    known = (native.compiler, native.folder, native._toolchain)
    for function in known:
        function.cache_clear()
    if native.compiler() is None:
        pytest.skip("no C compiler here")
    yield tmp_path / "cache"
    native.wait()
    for function in known:
        function.cache_clear()


@pytest.fixture(scope="module")
def shared_machine_code(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Functions of the uneven estimator are compiled once for all workers, as those of a user are, while they are used:
    digit for digit the numbers are those of the virtual machine, in a fifth of the time."""
    base = tmp_path_factory.getbasetemp()
    place = base.parent if "PYTEST_XDIST_WORKER" in os.environ else base
    known = (native.compiler, native.folder, native._toolchain, slip_functions)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("STICKSLIP_COMPILE", "1")
        patch.setenv("STICKSLIP_CACHE", str(place / "machine_code"))
        patch.setattr(compiled, "_all", weakref.WeakSet())  # what is made here is nothing to compile for later tests
        for function in known:
            function.cache_clear()
        yield
        native.stop()
        native.wait()
    for function in known:
        function.cache_clear()


@pytest.fixture
def no_predictions(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fits do not say where their pair sticks and slips, which takes longer than a quick fit: tests/prediction asks."""
    monkeypatch.setattr(result, "with_answers", lambda result, *_: result)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of the test's own, in which it stands."""
    monkeypatch.chdir(tmp_path)
    return tmp_path
