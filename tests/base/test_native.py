"""Machine code: the same numbers as the virtual machine, found again, and never needed."""

import os
import signal
import subprocess
import sys
import time
import weakref
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from identify.base import compiled as mapped
from identify.base import native
from identify.base.compiled import Mapped
from identify.effects import MAIN
from identify.model.model import assemble
from identify.shooting.blocks import AgeingBlock, RestBlock, SlideBlock, block


def function(factor: float = 2.0) -> ca.Function:
    x, y = ca.SX.sym("x", 2), ca.SX.sym("y")
    return ca.Function("sample", [x, y], [factor * x * ca.exp(y), ca.sin(y) / x[0]])


LANES = [np.linspace(0.1, 2.0, 10).reshape(5, 2), np.linspace(-1.0, 1.0, 5)]


def made(f: ca.Function) -> None:
    identity = native.key(f, lanes=True)
    assert identity is not None
    native.start([(f, identity)])
    native.wait()


def test_any_number_of_lanes_gives_what_the_formula_says():
    (x, y), run = LANES, Mapped(function(), 4)
    scaled, ratio = run([x, y])
    np.testing.assert_allclose(scaled, 2 * x * np.exp(y)[:, None], rtol=1e-15)
    np.testing.assert_allclose(ratio[:, 0], np.sin(y) / x[:, 0], rtol=1e-15)
    assert not run.native


def test_machine_code_is_found_by_the_next_who_asks_and_gives_the_same_numbers(machine_code):
    plain = Mapped(function(), 4)
    before = plain(LANES)
    made(function())
    again = Mapped(function(), 4)
    after = again(LANES)
    assert again.native and not plain.native
    for a, b in zip(before, after, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-14)
    assert not list(machine_code.glob("*.lock")) and not list(machine_code.glob("build-*"))


def test_another_function_is_not_mistaken_for_it(machine_code):
    made(function())
    other = Mapped(function(3.0), 4)
    np.testing.assert_allclose(other(LANES)[0], 3 * LANES[0] * np.exp(LANES[1])[:, None], rtol=1e-15)
    assert not other.native


@pytest.mark.parametrize("kind", [RestBlock("onset"), AgeingBlock(), SlideBlock(2), SlideBlock(2, worn=True)])
def test_shooting_blocks_agree_to_ten_digits(machine_code, kind):
    made_block = block(assemble(MAIN), kind)
    slots, constants, _, _ = made_block.expressions
    random = np.random.default_rng(3)
    given = [0.1 + 0.1 * random.random((7, slots.numel())), 0.5 + random.random((7, constants.numel()))]
    f = made_block.derivatives._function
    before = Mapped(f, 4)(given)
    made(f)
    compiled = Mapped(f, 4)
    after = compiled(given)
    assert compiled.native
    for a, b in zip(before, after, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-10, atol=1e-10 * np.max(np.abs(a)))


def test_what_costs_much_is_compiled_while_it_runs_at_first_quickly_then_well(machine_code, monkeypatch):
    monkeypatch.setattr(mapped, "WORTH", 0.0)
    monkeypatch.setattr(mapped, "RETRY", 0.0)
    run, levels = Mapped(function(5.0), 4), []
    before = run(LANES)
    for _ in range(3):
        native.wait()
        after = run(LANES)
        levels.append(sorted(library.name.partition("-")[0] for library in machine_code.glob("*.so")))
        for a, b in zip(before, after, strict=True):
            np.testing.assert_array_equal(a, b)
    assert run.native and not run.jobs
    assert levels == [["plain"], ["plain", "wide"], ["plain", "wide"]]


def test_what_is_kept_for_later_is_compiled_well_at_once(machine_code, monkeypatch):
    monkeypatch.setattr(mapped, "USED", 0.0)
    run = Mapped(function(9.0), 4)
    run(LANES)
    mapped.keep()
    native.wait()
    assert native.find(native.key(function(9.0), lanes=True), "sample") is not None
    again = Mapped(function(9.0), 4)
    again(LANES)
    assert again.native and not again.jobs, "the best there is"


def test_the_dearest_is_compiled_first_and_no_more_than_is_soon_done(machine_code, monkeypatch):
    started = []
    monkeypatch.setattr(mapped, "_all", weakref.WeakSet())
    monkeypatch.setattr(mapped, "WORTH", 0.0)
    monkeypatch.setattr(native, "start", started.append)
    cheap, dear = Mapped(function(2.0), 4), Mapped(function(3.0), 4)
    monkeypatch.setattr(mapped, "AT_ONCE", 0.0)
    cheap(LANES), dear(LANES)
    assert started == [[], []]
    takes = native.seconds(*cheap.jobs[0])
    for limit, expected in ((0.5 * takes, [dear]), (1.5 * takes, [dear, cheap])):
        monkeypatch.setattr(mapped, "AT_ONCE", limit)
        dear.spent, cheap.spent = 2.0, 1.0
        started.clear()
        mapped._compile()
        assert started == [[one.jobs[0] for one in expected]]


def test_the_larger_a_function_the_less_is_done_to_it(machine_code, monkeypatch):
    size = function().n_instructions()
    monkeypatch.setattr(native, "LEVELS", {"plain": ("-O0", 1.0, size), "improved": ("-O1", 2.0, size - 1)})
    (only,) = native.keys(function())
    assert only.startswith("plain-") and native.seconds(function(), only) == size
    monkeypatch.setattr(native, "LEVELS", {"plain": ("-O0", 1.0, size - 1)})
    assert native.keys(function()) == () and native.key(function(), lanes=True) is None


@pytest.mark.parametrize("lanes", [1, 3, 31, 32, 33, 70])
def test_lanes_beyond_the_last_full_call_are_not_filled_up(lanes, monkeypatch):
    monkeypatch.setattr(mapped, "WORK", 2 * function().n_instructions())  # two lanes hide a call
    run, x = Mapped(function()), np.linspace(0.1, 2.0, 2 * lanes).reshape(lanes, 2)
    calls = []
    really = mapped._Bench.run

    def noted(bench, given):
        calls.append((bench.chunk, given[0].shape[0]))
        return really(bench, given)

    monkeypatch.setattr(mapped._Bench, "run", noted)
    scaled, _ = run([x, np.zeros(lanes)])
    np.testing.assert_array_equal(scaled, 2 * x)
    assert calls == [(size, n) for size, n in ((32, lanes - lanes % 32), (2, lanes % 32)) if n]


HEAVY = """
import sys
from identify.base import native
from tests.base.test_native import large
f = large(int(sys.argv[1]))
native.start([(f, native.key(f))])
print(native._running[0].pid, flush=True)
sys.stdin.readline()
"""


def large(terms: int) -> ca.Function:
    """A function that takes seconds to compile."""
    x, out = ca.SX.sym("x"), 0.0
    for i in range(terms):
        out = ca.sin(out * x + i)
    return ca.Function("large", [x], [out])


def group_is_gone(group: int, within: float) -> bool:
    until = time.monotonic() + within
    while time.monotonic() < until:
        try:
            os.killpg(group, 0)
        except ProcessLookupError:
            return True
        time.sleep(0.02)
    return False


@pytest.mark.parametrize("end", ["closed", signal.SIGKILL])
def test_what_is_compiled_ends_with_its_process_however_that_ends(machine_code, end):
    """And leaves nothing behind; a compiler that takes half a minute stands for a large function."""
    script = f"import identify.base.native as n; n.LINGER = 0; n._granted.append(-1e3)\n{HEAVY}"
    cc = machine_code.parent / "bin" / "cc"
    cc.parent.mkdir()
    cc.write_text("#!/bin/sh\nsleep 30\n", encoding="ascii")
    cc.chmod(0o755)
    environment = {
        **os.environ,
        "PYTHONPATH": str(Path(__file__).resolve().parents[2]),
        "PATH": f"{cc.parent}{os.pathsep}{os.environ['PATH']}",
    }
    command = [sys.executable, "-c", script, "50"]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=environment) as process:
        group = int(process.stdout.readline())
        assert not group_is_gone(group, 0.5), "it works while its process lives"
        process.stdin.close() if end == "closed" else process.send_signal(end)
        process.wait()
        assert group_is_gone(group, 2.0)
    assert [path.name for path in machine_code.iterdir()] == []


def test_the_compiler_steps_back_and_is_told_to_stop(machine_code):
    """Nice counts within a session only; an interrupt from the keyboard reaches the foreground's process group."""
    f = large(5000)
    native.start([(f, native.key(f))])
    (compiling,) = native._running
    assert os.getsid(compiling.pid) == os.getsid(0)
    assert os.getpgid(compiling.pid) != os.getpgid(0)
    assert "nice -n 10" in native.SCRIPT and "ulimit -t" in native.SCRIPT
    time.sleep(0.5)  # it is at work
    native.stop()
    assert compiling.wait(5.0) == 0 and group_is_gone(compiling.pid, 2.0)
    assert list(machine_code.iterdir()) == []


def test_no_more_is_compiled_than_the_process_itself_has_taken(machine_code, monkeypatch):
    needed = native.SLOWER * native.seconds(function(3.0), native.key(function(3.0), lanes=True))
    for spent, expected in ((0.9, 0), (1.1, 1), (1.9, 1), (2.1, 2)):
        monkeypatch.setattr(native, "_granted", [])
        monkeypatch.setattr(native.time, "process_time", lambda spent=spent: spent * needed)
        jobs = [(f, native.key(f, lanes=True)) for f in (function(2.0 + spent), function(20.0 + spent))]
        native.start(jobs)
        native.wait()
        assert sum(native.find(key, "sample") is not None for _, key in jobs) == expected
    assert not list(machine_code.glob("*.lock"))


def test_a_compilation_that_takes_too_long_is_ended_and_marked(machine_code, monkeypatch):
    monkeypatch.setattr(native, "LEVELS", {"plain": ("-O2", 0.0, 10**9)})  # promised in no time, granted 1 s
    f = large(20_000)
    began = time.monotonic()
    native.start([(f, native.key(f))])
    native.wait()
    assert native.failed(native.key(f)) and time.monotonic() - began < 20.0
    assert [path.suffix for path in machine_code.iterdir()] == [".failed"]


def test_the_cache_keeps_to_its_limit_and_lets_go_of_the_oldest(machine_code, monkeypatch):
    base, day = native.folder(), 86_400.0
    for number in range(4):
        path = base / f"plain-{number}.so"
        path.write_bytes(bytes(400_000))
        os.utime(path, (time.time() - day * (4 - number),) * 2)
    (base / "mine.so").write_bytes(bytes(10))  # not of ours: stays
    monkeypatch.setenv("STICKSLIP_CACHE_MB", "1")
    native.make_room(base)
    assert sorted(path.name for path in base.iterdir()) == ["mine.so", "plain-2.so", "plain-3.so"]
    monkeypatch.setenv("STICKSLIP_CACHE_MB", "nonsense")
    assert native.limit() == native.LIMIT


def test_what_is_used_again_is_not_the_oldest(machine_code):
    made(function())
    (library,) = machine_code.glob("*.so")
    os.utime(library, (time.time() - 1e6,) * 2)
    assert native.find(native.key(function(), lanes=True), "sample") is not None
    assert native._age(library) < 60.0


def test_a_damaged_library_is_as_good_as_none(machine_code):
    made(function())
    (library,) = machine_code.glob("*.so")
    library.write_bytes(b"no library")
    run = Mapped(function(), 4)
    np.testing.assert_allclose(run(LANES)[0], 2 * LANES[0] * np.exp(LANES[1])[:, None], rtol=1e-15)
    assert not run.native and not library.exists()


@pytest.fixture
def failing(machine_code, tmp_path, monkeypatch):
    """A compiler that is there and fails; the file it notes its starts in."""
    noted = tmp_path / "starts"
    noted.touch()
    (tmp_path / "bin").mkdir()
    (tmp_path / "bin" / "cc").write_text(f"#!/bin/sh\necho once >> {noted}\nexit 1\n", encoding="ascii")
    (tmp_path / "bin" / "cc").chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path / 'bin'}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.setattr(mapped, "WORTH", 0.0)
    monkeypatch.setattr(mapped, "RETRY", 0.0)
    for known in (native.compiler, native._translator):
        known.cache_clear()
    return noted


def used_much(run: Mapped) -> None:
    expected = [function()(x, y)[0].full().ravel() for x, y in zip(*LANES, strict=True)]
    for _ in range(6):
        np.testing.assert_array_equal(run(LANES)[0], expected)
        native.wait()


def test_a_compiler_that_fails_is_not_asked_again(failing, machine_code):
    levels = len(native.keys(function(), lanes=True))
    for run in (Mapped(function(), 4), Mapped(function(), 4)):  # the second one as another process would ask
        used_much(run)
        mapped.keep()
        native.wait()
        assert not run.native and not run.jobs
        assert len(failing.read_text(encoding="ascii").split()) == levels
    assert not list(machine_code.glob("*.lock")) and not list(machine_code.glob("build-*"))


def test_a_day_later_it_is(failing, machine_code):
    used_much(Mapped(function(), 4))
    before = failing.stat().st_size
    for mark in machine_code.glob("*.failed"):
        os.utime(mark, (time.time() - native.AGAIN - 1.0,) * 2)
    used_much(Mapped(function(), 4))
    assert failing.stat().st_size == 2 * before > 0


def test_what_cannot_be_written_gives_up_its_own_claim_only(machine_code, monkeypatch):
    jobs = [(f, native.key(f, lanes=True)) for f in (function(2.0), function(3.0), function(4.0))]
    really = native.wide.code

    def full(f, lanes):
        if f is jobs[1][0]:
            raise OSError("the disk is full")
        return really(f, lanes)

    monkeypatch.setattr(native.wide, "code", full)
    native.start(jobs)
    native.wait()
    assert [native.find(key, "sample") is not None for _, key in jobs] == [True, False, True]
    assert native.failed(jobs[1][1])
    assert not list(machine_code.glob("*.lock")) and not list(machine_code.glob("build-*"))


def test_without_a_process_to_compile_in_nothing_stays_claimed(machine_code, monkeypatch):
    def none(*_, **__):
        raise BlockingIOError("no more processes")

    monkeypatch.setattr(native.subprocess, "Popen", none)
    made(function())
    assert not list(machine_code.glob("*.lock")) and not list(machine_code.glob("build-*"))


def test_what_dead_processes_left_is_removed_and_what_others_are_at_is_not(machine_code):
    f, base = function(), native.folder()
    dead, alive = base / "build-dead", base / "build-alive"
    lock = base / f"{native.key(f, lanes=True)}.lock"
    for folder in (dead, alive):
        folder.mkdir()
        (folder / "name").write_text("plain-0", encoding="ascii")
    lock.touch()
    long_ago = (time.time() - native.STALE - 1.0,) * 2
    os.utime(dead, long_ago)
    made(f)
    assert not list(base.glob("*.so")), "another process is at it"
    os.utime(lock, long_ago)
    made(f)
    assert list(base.glob("*.so")) and not lock.exists()
    assert alive.exists() and not dead.exists()


def test_a_lock_that_goes_while_it_is_looked_at_is_no_failure(machine_code, monkeypatch):
    """Between two looks at a lock another process may remove it: seen, then not there."""
    exists = Path.exists
    with monkeypatch.context() as then:
        then.setattr(Path, "exists", lambda path, **more: path.suffix == ".lock" or exists(path, **more))
        made(function())
    assert list(machine_code.glob("*.so"))


def test_code_that_cannot_be_loaded_is_not_made_again_and_again(machine_code, monkeypatch):
    """A cache on a disk from which nothing may be run."""
    monkeypatch.setattr(mapped, "WORTH", 0.0)
    monkeypatch.setattr(mapped, "RETRY", 0.0)

    def refused(*_):
        raise RuntimeError("failed to map segment")

    monkeypatch.setattr(native.ca, "external", refused)
    run = Mapped(function(), 4)
    used_much(run)
    assert not run.native and not run.jobs and not list(machine_code.glob("*.so"))


def test_a_folder_that_others_can_write_to_is_not_trusted(machine_code):
    native.folder()
    machine_code.chmod(0o777)
    native.folder.cache_clear()
    assert native.folder() is None and native.key(function(), lanes=True) is None


def test_nothing_is_compiled_where_it_is_switched_off(machine_code, monkeypatch):
    monkeypatch.setenv("STICKSLIP_COMPILE", "0")
    native.compiler.cache_clear()
    assert native.key(function(), lanes=True) is None
