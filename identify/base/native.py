"""CasADi functions as machine code: written as C, compiled once in the background, kept in the user's cache.

A library is found by the hash of what its function computes, and loaded only where its bytes have the checksum that
stands in its name: a damaged one is removed and compiled again. The compiler keeps the order of the arithmetic (no
contraction, no fast-math), so that machine code and CasADi's virtual machine give the same numbers.

Environment: STICKSLIP_COMPILE=0 keeps the virtual machine; STICKSLIP_CACHE names another folder, STICKSLIP_CACHE_MB
another limit of its size; what was not used for longest goes first.
"""

from __future__ import annotations

import hashlib
import math
import os
import platform
import shutil
import signal
import stat
import subprocess
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from functools import cache
from pathlib import Path

import casadi as ca

from identify.base import compile_worker

OPTIONS = ("-O1", "-ffp-contract=off", "-fPIC", "-shared")
LARGEST = 90_000  # instructions of a function that is compiled
PER_INSTRUCTION = 1.5e-4  # seconds that compiling takes
AGAIN = 86_400.0  # seconds after which a function that could not be compiled is tried again
LIMIT = 64.0  # MB of machine code that are kept

_running: list[tuple[subprocess.Popen[bytes], list[Path]]] = []  # one at a time, and its build folders


@cache
def compiler() -> str | None:
    """The C compiler, or None where there is none or none is wanted."""
    if os.name != "posix" or os.environ.get("STICKSLIP_COMPILE", "1") == "0":
        return None
    return shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")


@cache
def folder() -> Path | None:
    """The cache: a folder that only this user can write to, or None."""
    named = os.environ.get("STICKSLIP_CACHE")
    try:
        base = Path(named) if named else Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "stickslip"
        base.mkdir(mode=0o700, parents=True, exist_ok=True)
        about = base.stat()
    except (OSError, RuntimeError):  # no home, or one that cannot be written to
        return None
    foreign = hasattr(os, "getuid") and about.st_uid != os.getuid()
    shared = about.st_mode & (stat.S_IWOTH | stat.S_IWGRP)
    return None if foreign or shared or not os.access(base, os.W_OK) else base


@cache
def register() -> tuple[int, tuple[str, ...]]:
    """How many rows of a batch a register of this processor holds, and the compiler's options for it."""
    with suppress(OSError):
        known = Path("/proc/cpuinfo").read_text(encoding="ascii", errors="replace").split()
        if "avx2" in known and platform.machine() == "x86_64":
            return 4, ("-mavx2",)
    return 2, ()


@cache
def _toolchain() -> str:
    """What besides the function decides about the machine code: compiler, its version, options, CasADi, processor."""
    path = Path(compiler() or "/").resolve()
    parts = (path, path.stat().st_mtime_ns, *OPTIONS, VERSION, register(), ca.__version__, platform.machine())
    return "\n".join(map(str, parts))


def key(function: ca.Function, *, simd: bool = False) -> str | None:
    """What a function computes, as a hash; None where it is not compiled here.

    Args:
        simd: compiled for several rows of a batch at once where every operation can be written so.
    """
    if compiler() is None or folder() is None or function.n_instructions() > LARGEST:
        return None
    computes = hashlib.sha256((_toolchain() + function.serialize()).encode()).hexdigest()[:40]
    return f"{'simd' if simd else 'plain'}-{computes}"


def find(identity: str, name: str) -> ca.Function | None:
    """The compiled function of this key and name, or None where there is none that is sound."""
    base = folder()
    for path in () if base is None else sorted(base.glob(f"{identity}.*.so")):
        with suppress(OSError):  # another process has just removed it
            if path.name == compile_worker.library_name(identity, path.read_bytes()):
                os.utime(path)  # used just now: the last to go where the cache is full
                try:
                    return ca.external(name, str(path))
                except RuntimeError:  # nothing in this folder may be executed, say
                    path.with_name(f"{identity}.failed").touch()
            path.unlink(missing_ok=True)
    return None


def failed(identity: str) -> bool:
    """Whether compiling for this key failed, here or in another process, within a day."""
    with suppress(OSError):
        mark = (folder() or Path()) / f"{identity}.failed"
        return time.time() - mark.stat().st_mtime < AGAIN
    return False


def busy() -> bool:
    """Whether a compilation started here is still running."""
    _running[:] = [(process, builds) for process, builds in _running if process.poll() is None]
    return bool(_running)


def wait() -> None:
    """Until what was started here is compiled; for tests and timings."""
    for process, _ in _running:
        process.wait()
    _running.clear()


def stop() -> None:
    """End what is being compiled, and leave nothing of it behind."""
    for process, builds in _running:
        with suppress(OSError):
            os.killpg(process.pid, signal.SIGTERM)
        for build in builds:
            shutil.rmtree(build, ignore_errors=True)


def start(jobs: Sequence[tuple[ca.Function, str]]) -> None:
    """Start compiling functions under their keys in the background, those that no other process is at or failed at."""
    base, cc = folder(), compiler()
    if base is None or cc is None:
        return
    make_room(base)
    builds: list[Path] = []
    for function, identity in jobs:
        build = base / f"build-{identity}"
        with suppress(OSError, RuntimeError):  # another process is at it, no room, or CasADi has no C for it
            if failed(identity):
                continue
            build.mkdir(mode=0o700)
            builds.append(build)
            text = simd_code(function, register()[0]) if identity.startswith("simd") else None
            if text is not None:
                (build / "function.c").write_text(text, encoding="ascii")
                continue
            generator = ca.CodeGenerator("function.c")
            generator.add(function)
            generator.generate(f"{build}{os.sep}")
    if not builds:
        return
    command: list[str | Path] = [sys.executable, "-I", "-S", compile_worker.__file__, base]
    command += [cc, *OPTIONS, *register()[1], "--", *builds]
    quiet = subprocess.DEVNULL
    try:  # in the session of this process: Linux shares processors among sessions first, and nice counts within one
        process = subprocess.Popen(command, stdin=quiet, stdout=quiet, stderr=quiet, process_group=0)
        _running.append((process, builds))
    except OSError:  # no more processes: the virtual machine goes on
        for build in builds:
            shutil.rmtree(build, ignore_errors=True)


def make_room(base: Path) -> None:
    """Remove what was left behind, and what was not used for longest until the cache holds no more than its limit."""
    stated = os.environ.get("STICKSLIP_CACHE_MB", "")
    room = 1e6 * (float(stated) if stated.replace(".", "", 1).isdigit() else LIMIT)
    with suppress(OSError):  # another process has removed one meanwhile
        for left in base.glob("build-*"):
            if time.time() - left.stat().st_mtime > 10.0 * compile_worker.LONGEST:
                shutil.rmtree(left, ignore_errors=True)
        files = [(path.stat(), path) for kind in ("simd", "plain", "wide") for path in base.glob(f"{kind}-*.*")]
        for about, path in sorted(files, key=lambda file: -file[0].st_mtime):
            room -= about.st_size
            if room < 0:
                path.unlink(missing_ok=True)


# ----------------------------------------------------------------------------------------------------------------------
# C code for several rows of a batch at once. What a function computes is a list of instructions on scalars; each is
# written for rows side by side, in the vector types of GCC and Clang. Row by row the arithmetic is the same, in the
# same order: the numbers are the same.
# ----------------------------------------------------------------------------------------------------------------------

VERSION = 1  # counts up when what is written changes: older machine code is not found again then
HEAD = """#include <math.h>
typedef double V __attribute__((vector_size({bytes})));
typedef long long M __attribute__((vector_size({bytes})));
#define EACH(f, x) (V){{{each}}}
#define PAIR(f, x, y) (V){{{pair}}}
#define WHERE(m, x) ((V)((M)(m) & (M)(x)))
#define EITHER(m, x, y) ((V)(((M)(m) & (M)(x)) | (~(M)(m) & (M)(y))))
#define TRUE(m) WHERE(m, ONE)
static const V ZERO = {{0}}, ONE = {{{ones}}};
"""
# Every operation in C, on vectors x and y; a function with another one is compiled for one row at a time.
OPERATIONS: dict[int, str] = {
    getattr(ca, f"OP_{name}"): text
    for name, text in {
        "ASSIGN": "{x}",
        "ADD": "{x} + {y}",
        "SUB": "{x} - {y}",
        "MUL": "{x} * {y}",
        "DIV": "{x} / {y}",
        "NEG": "-{x}",
        "TWICE": "{x} + {x}",
        "SQ": "{x} * {x}",
        "INV": "ONE / {x}",
        "LT": "TRUE({x} < {y})",
        "LE": "TRUE({x} <= {y})",
        "EQ": "TRUE({x} == {y})",
        "NE": "TRUE({x} != {y})",
        "NOT": "TRUE({x} == ZERO)",
        "AND": "TRUE(({x} != ZERO) & ({y} != ZERO))",
        "OR": "TRUE(({x} != ZERO) | ({y} != ZERO))",
        "IF_ELSE_ZERO": "WHERE({x} != ZERO, {y})",
        "FMIN": "EITHER(({x} <= {y}) | ({y} != {y}), {x}, {y})",
        "FMAX": "EITHER(({x} >= {y}) | ({y} != {y}), {x}, {y})",
        "FABS": "EACH(fabs, {x})",
        "CONSTPOW": "PAIR(pow, {x}, {y})",
        **{name: f"PAIR({name.lower()}, {{x}}, {{y}})" for name in ("POW", "ATAN2", "COPYSIGN")},
        **{
            name.upper(): f"EACH({name}, {{x}})"
            for name in "sqrt exp expm1 log log1p sinh cosh tanh sin cos tan asin acos atan".split()
        },
    }.items()
}


def simd_code(function: ca.Function, rows: int) -> str | None:
    """C code of a function for so many rows, one after the other in its arguments and results, as a library that CasADi
    loads under the same name; None where the function does something that is not written here."""
    name, each = function.name(), range(rows)
    head = {
        "each": ", ".join(f"f((x)[{i}])" for i in each),
        "pair": ", ".join(f"f((x)[{i}], (y)[{i}])" for i in each),
        "ones": ", ".join("1" for _ in each),
    }
    lines = [HEAD.format(bytes=8 * rows, **head)]
    inputs = [function.numel_in(i) for i in range(function.n_in())]
    outputs = [function.numel_out(i) for i in range(function.n_out())]
    for kind, sizes in (("in", inputs), ("out", outputs)):
        lines += [f"static const long long {kind}_{i}[] = {{{size}, {rows}, 1}};" for i, size in enumerate(sizes)]
        lines += [
            f"long long {name}_n_{kind}(void) {{ return {len(sizes)}; }}",
            f"const long long* {name}_sparsity_{kind}(long long i) {{",
            f"  static const long long* const all[] = {{{', '.join(f'{kind}_{i}' for i in range(len(sizes)))}}};",
            f"  return i < {len(sizes)} ? all[i] : 0;",
            "}",
        ]
    lines += [
        f"int {name}(const double** arg, double** res, long long* iw, double* w, int mem) {{",
        f"  V {', '.join(f'a{i}' for i in range(max(function.sz_w(), 1)))};",
    ]
    for k in range(function.n_instructions()):
        kind, used, result = function.instruction_id(k), function.instruction_input(k), function.instruction_output(k)
        if kind == ca.OP_INPUT:
            i, place = used
            values = ", ".join(f"arg[{i}][{row * inputs[i] + place}]" for row in each)
            lines.append(f"  a{result[0]} = arg[{i}] ? (V){{{values}}} : ZERO;")
        elif kind == ca.OP_OUTPUT:
            i, place = result
            put = " ".join(f"res[{i}][{row * outputs[i] + place}] = a{used[0]}[{row}];" for row in each)
            lines.append(f"  if (res[{i}]) {{ {put} }}")
        elif kind == ca.OP_CONST and math.isfinite(value := float(function.instruction_constant(k))):
            lines.append(f"  a{result[0]} = (V){{{', '.join([value.hex()] * rows)}}};")
        elif kind in OPERATIONS:
            lines.append(f"  a{result[0]} = {OPERATIONS[kind].format(x=f'a{used[0]}', y=f'a{used[-1]}')};")
        else:  # hexadecimal numbers of C are finite
            return None
    return "\n".join([*lines, "  return 0;", "}", ""])
