"""Machine code: digit for digit the numbers of the virtual machine, found again, and never needed."""

import os
import signal
import time

import casadi as ca
import numpy as np
import pytest

from identify.base import native
from identify.base.compiled import Mapped
from identify.effects import MAIN
from identify.model.model import assemble
from identify.shooting.blocks import AgeingBlock, SlideBlock, block

ROWS = [np.linspace(0.1, 2.0, 10).reshape(5, 2), np.linspace(-1.0, 1.0, 5)]


def function(factor: float = 2.0) -> ca.Function:
    x, y = ca.SX.sym("x", 2), ca.SX.sym("y")
    return ca.Function("sample", [x, y], [factor * x * ca.exp(y), ca.sin(y) / x[0]])


def made(f: ca.Function) -> None:
    identity = native.key(f)
    assert identity is not None
    native.start([(f, identity)])
    native.wait()


def test_machine_code_is_found_by_the_next_who_asks_and_not_for_another_function(machine_code):
    plain = Mapped(function(), 4)
    before = plain(ROWS)
    np.testing.assert_allclose(before[0], 2 * ROWS[0] * np.exp(ROWS[1])[:, None], rtol=1e-15)
    made(function())
    again, other = Mapped(function(), 4), Mapped(function(3.0), 4)
    for a, b in zip(before, again(ROWS), strict=True):
        np.testing.assert_array_equal(a, b)
    assert again.native and not plain.native and not list(machine_code.glob("build-*"))
    np.testing.assert_allclose(other(ROWS)[0], 3 * ROWS[0] * np.exp(ROWS[1])[:, None], rtol=1e-15)
    assert not other.native


@pytest.mark.parametrize("kind", [AgeingBlock(), SlideBlock(2)])
def test_shooting_blocks_agree_to_ten_digits(machine_code, kind):
    made_block = block(assemble(MAIN), kind)
    slots, constants, _, _ = made_block.expressions
    random = np.random.default_rng(3)
    given = [0.1 + 0.1 * random.random((7, slots.numel())), 0.5 + random.random((7, constants.numel()))]
    f = made_block.derivatives.function
    before = Mapped(f, 4)(given)
    made(f)
    code = Mapped(f, 4)
    after = code(given)
    assert code.native
    for a, b in zip(before, after, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-10, atol=1e-10 * np.max(np.abs(a)))


@pytest.mark.parametrize("end", [native.stop, lambda: os.killpg(native._running[0].pid, signal.SIGTERM)])
def test_what_is_compiled_ends_when_it_is_stopped(machine_code, tmp_path, monkeypatch, end):
    """And leaves nothing behind; a compiler that takes half a minute stands for a large function."""
    fake_compiler(tmp_path, monkeypatch, "sleep 30")
    native.start([(function(), native.key(function()))])
    process, began = native._running[0], time.monotonic()
    time.sleep(0.5)
    assert native.busy() and list(machine_code.glob("build-*"))
    end()
    process.wait(20.0)
    assert time.monotonic() - began < 20.0 and not list(machine_code.iterdir())


def test_the_cache_keeps_to_its_limit_and_lets_go_of_the_oldest(machine_code, monkeypatch):
    base, day = native.folder(), 86_400.0
    names = [f"plain-{number:040}.0123456789abcdef.so" for number in range(4)]
    for number, name in enumerate(names):
        (base / name).write_bytes(bytes(400_000))
        os.utime(base / name, (time.time() - day * (4 - number),) * 2)
    (base / "mine.so").write_bytes(bytes(10))  # not of ours: stays
    monkeypatch.setenv("STICKSLIP_CACHE_MB", "1")
    native.make_room(base)
    assert sorted(path.name for path in base.iterdir()) == ["mine.so", *names[2:]]


def used_much(run: Mapped, times: int = 4) -> None:
    """Calls as of a function that has cost much more than compiling it; every one gives the right numbers."""
    expected = [function()(x, y)[0].full().ravel() for x, y in zip(*ROWS, strict=True)]
    for _ in range(times):
        run.spent += 2.0 * run.cost + 1.0
        np.testing.assert_array_equal(run(ROWS)[0], expected)
        native.wait()


def test_thirty_damaged_libraries_are_thrown_away_and_made_again(machine_code):
    """Cut to a fraction, or with flipped bits: none is ever loaded."""
    made(function())
    (library,) = machine_code.glob("*.so")
    sound, random = library.read_bytes(), np.random.default_rng(5)
    cuts = [sound[: int(share * len(sound))] for share in np.linspace(0.0, 0.99, 15)]
    flips = []
    for _ in range(15):
        bits = np.unpackbits(np.frombuffer(sound, np.uint8))
        bits[random.integers(0, bits.size, 16)] ^= 1
        flips.append(np.packbits(bits).tobytes())
    for data in (*cuts, *flips):
        library.write_bytes(data)
        run = Mapped(function(), 4)
        np.testing.assert_allclose(run(ROWS)[0], 2 * ROWS[0] * np.exp(ROWS[1])[:, None], rtol=1e-15)
        assert not run.native and not library.exists() and not native.failed(run.key)
    used_much(run)
    assert run.native and library.read_bytes() == sound


def fake_compiler(tmp_path, monkeypatch, script):
    (tmp_path / "bin").mkdir()
    (tmp_path / "bin" / "cc").write_text(f"#!/bin/sh\n{script}\n", encoding="ascii")
    (tmp_path / "bin" / "cc").chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path / 'bin'}{os.pathsep}{os.environ['PATH']}")
    for known in (native.compiler, native._toolchain):
        known.cache_clear()


def test_a_compiler_that_fails_is_not_run_again_for_a_day(machine_code, tmp_path, monkeypatch):
    noted = tmp_path / "starts"
    fake_compiler(tmp_path, monkeypatch, f"echo once >> {noted}\nexit 1")
    for _ in range(2):  # the second one as another process would ask
        run = Mapped(function(), 4)
        used_much(run)
        assert not run.native and run.settled and noted.read_text(encoding="ascii") == "once\n"
    assert not list(machine_code.glob("build-*"))
    (mark,) = machine_code.glob("*.failed")
    os.utime(mark, (time.time() - native.AGAIN - 1.0,) * 2)
    used_much(Mapped(function(), 4))
    assert noted.read_text(encoding="ascii") == "once\nonce\n"


def test_a_folder_that_others_can_write_to_is_not_trusted(machine_code):
    native.folder()
    machine_code.chmod(0o777)
    native.folder.cache_clear()
    assert native.folder() is None and native.key(function()) is None
