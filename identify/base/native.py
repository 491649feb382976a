"""CasADi functions as machine code: written as C, compiled once in the background, kept in the user's cache.

A library is found by the hash of what its function computes, and loaded only where its bytes have the checksum that
stands in its name: a damaged one is removed and compiled again. The compiler keeps the order of the arithmetic (no
contraction, no fast-math), so that machine code and CasADi's virtual machine give the same numbers.

Environment: STICKSLIP_COMPILE=0 keeps the virtual machine; STICKSLIP_CACHE names another folder, STICKSLIP_CACHE_MB
another limit of its size; what was not used for longest goes first.
"""

from __future__ import annotations

import hashlib
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
    parts = (path, path.stat().st_mtime_ns, *OPTIONS, ca.__version__, platform.machine())
    return "\n".join(map(str, parts))


def key(function: ca.Function) -> str | None:
    """What a function computes, as a hash; None where it is not compiled here."""
    if compiler() is None or folder() is None or function.n_instructions() > LARGEST:
        return None
    return "plain-" + hashlib.sha256((_toolchain() + function.serialize()).encode()).hexdigest()[:40]


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
        return abs(time.time() - mark.stat().st_mtime) < AGAIN
    return False


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
    """End what is being compiled; its process leaves nothing behind."""
    for process in _running:
        with suppress(OSError):
            os.killpg(process.pid, signal.SIGTERM)


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
            generator = ca.CodeGenerator("function.c")
            generator.add(function)
            generator.generate(f"{build}{os.sep}")
    if not builds:
        return
    command: list[str | Path] = [sys.executable, "-I", "-S", compile_worker.__file__, base]
    command += [cc, *OPTIONS, "--", *builds]
    quiet = subprocess.DEVNULL
    try:  # in the session of this process: Linux shares processors among sessions first, and nice counts within one
        _running.append(subprocess.Popen(command, stdin=quiet, stdout=quiet, stderr=quiet, process_group=0))
    except OSError:  # no more processes: the virtual machine goes on
        for build in builds:
            shutil.rmtree(build, ignore_errors=True)


def make_room(base: Path) -> None:
    """Remove what was left behind, and what was not used for longest until the cache holds no more than its limit."""
    stated = os.environ.get("STICKSLIP_CACHE_MB", "")
    room = 1e6 * (float(stated) if stated.replace(".", "", 1).isdigit() else LIMIT)
    with suppress(OSError):  # another process has removed one meanwhile
        for left in base.glob("build-*"):
            if abs(time.time() - left.stat().st_mtime) > 10.0 * compile_worker.LONGEST:
                shutil.rmtree(left, ignore_errors=True)
        files = [(path.stat(), path) for path in base.glob("plain-*.*")]
        for about, path in sorted(files, key=lambda file: -file[0].st_mtime):
            room -= about.st_size
            if room < 0:
                path.unlink(missing_ok=True)
