"""CasADi functions as machine code: translated to C, compiled once in the background, kept in the user's cache.

A library is found by the hash of what its function computes, and loaded only where its bytes have the checksum that
stands in its name: a damaged one is removed and compiled again. The compiler keeps the order of the arithmetic (no
contraction, no fast-math), so that machine code and CasADi's virtual machine give the same numbers. A function that
could not be compiled leaves a mark, and no process tries it again for a day.

Environment: STICKSLIP_COMPILE=0 keeps the virtual machine; STICKSLIP_CACHE names another folder, STICKSLIP_CACHE_MB
another limit of its size; what was not used for longest goes first.
"""

from __future__ import annotations

import hashlib
import math
import os
import platform
import re
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

from identify.base import compile_worker, wide

OPTIONS = ("-O1", "-ffp-contract=off", "-fPIC", "-shared")
LARGEST = 90_000  # instructions of a function that is compiled
PER_INSTRUCTION = 1.5e-4  # seconds that compiling takes
STALE = 900.0  # seconds after which the unfinished work of another process counts as left behind
AGAIN = 86_400.0  # seconds after which a function that could not be compiled is tried again
LINGER = 10  # seconds that compiling goes on after the process it serves: the next one finds it done
LIMIT = 64_000_000  # bytes of machine code that are kept
OURS = re.compile(r"[a-z]+-[0-9a-f]{40}(\.[0-9a-f]{16})?\.(so|failed)")

_running: list[subprocess.Popen[bytes]] = []  # one at a time


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
def _toolchain() -> str:
    """What besides the function decides about the machine code: compiler, its version, options, CasADi, processor."""
    path = Path(compiler() or "/").resolve()
    parts = (path, path.stat().st_mtime_ns, *OPTIONS, wide.VERSION, wide.register(), ca.__version__)
    return "\n".join(map(str, (*parts, platform.machine())))


def key(function: ca.Function, *, lanes: bool = False) -> str | None:
    """What a function computes, as a hash; None where it is not compiled here.

    Args:
        lanes: compiled for several lanes at once where every operation can be written so (`wide`).
    """
    if compiler() is None or folder() is None or function.n_instructions() > LARGEST:
        return None
    computes = hashlib.sha256((_toolchain() + function.serialize()).encode()).hexdigest()[:40]
    return f"{'wide' if lanes else 'plain'}-{computes}"


def seconds(function: ca.Function) -> float:
    """What compiling takes, roughly."""
    return PER_INSTRUCTION * float(function.n_instructions())


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
                    _mark(path.with_name(f"{identity}.failed"))
            path.unlink(missing_ok=True)
    return None


def failed(identity: str) -> bool:
    """Whether compiling for this key failed, here or in another process, within a day."""
    base = folder()
    return base is not None and _age(base / f"{identity}.failed") < AGAIN


def busy() -> bool:
    """Whether a compilation started here is still running."""
    _running[:] = [process for process in _running if process.poll() is None]
    return bool(_running)


def wait() -> None:
    """Until what was started here is compiled; for tests and timings."""
    for process in _running:
        process.wait()
    _running.clear()


def stop() -> None:
    """End what is being compiled; it leaves nothing behind."""
    for process in _running:
        with suppress(OSError):
            os.killpg(process.pid, signal.SIGTERM)


def start(jobs: Sequence[tuple[ca.Function, str]]) -> None:
    """Start compiling functions under their keys in the background, those that no other process is at or failed at."""
    base, cc = folder(), compiler()
    if base is None or cc is None:
        return
    for left in base.glob("build-*"):
        if _age(left) > STALE:
            shutil.rmtree(left, ignore_errors=True)
    make_room(base)
    builds = [build for function, identity in jobs if (build := _claimed(base, function, identity)) is not None]
    if not builds:
        return
    command: list[str | Path] = [sys.executable, "-I", "-S", compile_worker.__file__, base, str(LINGER)]
    command += [cc, *OPTIONS, *wide.register()[1], "--", *builds]
    quiet = subprocess.DEVNULL
    try:  # in the session of this process: Linux shares processors among sessions first, and nice counts within one
        _running.append(subprocess.Popen(command, stdin=subprocess.PIPE, stdout=quiet, stderr=quiet, process_group=0))
    except OSError:  # no more processes: the virtual machine goes on
        for build in builds:
            shutil.rmtree(build, ignore_errors=True)


def _claimed(base: Path, function: ca.Function, identity: str) -> Path | None:
    """A new folder with the C code of a function; None where another process is at it, or it failed or fails now."""
    build = base / f"build-{identity}"
    if failed(identity):
        return None
    try:
        build.mkdir(mode=0o700)
    except OSError:
        return None
    try:
        code = wide.code(function, wide.register()[0]) if identity.startswith("wide") else None
        if code is None:
            generator = ca.CodeGenerator("function.c")
            generator.add(function)
            generator.generate(f"{build}{os.sep}")
        else:
            (build / "function.c").write_text(code, encoding="ascii")
        return build
    except (OSError, RuntimeError):  # the disk is full, or CasADi has no C for it
        _mark(base / f"{identity}.failed")
        shutil.rmtree(build, ignore_errors=True)
        return None


def _mark(path: Path) -> None:
    with suppress(OSError):
        path.touch()


def limit() -> int:
    """Bytes of machine code that are kept."""
    text = os.environ.get("STICKSLIP_CACHE_MB", "")
    return int(1e6 * float(text)) if text.replace(".", "", 1).isdigit() else LIMIT


def contents(base: Path) -> list[tuple[float, int, Path]]:
    """Every file of ours in the cache: when it was used last, its size in bytes, its path; the oldest first."""
    files = []
    for path in base.iterdir():
        if OURS.fullmatch(path.name):
            with suppress(OSError):
                about = path.stat()
                files.append((about.st_mtime, about.st_size, path))
    return sorted(files)


def make_room(base: Path) -> None:
    """Remove what was not used for longest until the cache holds no more than its limit."""
    files = contents(base)
    size = sum(each for _, each, _ in files)
    for _, each, path in files:
        if size <= limit():
            break
        path.unlink(missing_ok=True)
        size -= each


def _age(path: Path) -> float:
    """Seconds since a file or folder was changed; NaN where there is none."""
    try:
        return time.time() - path.stat().st_mtime
    except OSError:
        return math.nan
