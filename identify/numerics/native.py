"""Functions as machine code: translated to C, compiled once, kept in the user's cache; nothing waits for it.

A function that has cost some time in CasADi's virtual machine is compiled in the background where a C compiler
exists, and found again by every later process through the hash of what it computes. The compiler keeps the order
of the arithmetic (no contraction, no fast-math), so both ways give the same numbers.

Environment: STICKSLIP_COMPILE=0 keeps the virtual machine; STICKSLIP_CACHE names another folder.
"""

from __future__ import annotations

import hashlib
import os
import platform
import shutil
import stat
import subprocess
import tempfile
import time
from collections.abc import Sequence
from functools import cache
from pathlib import Path

import casadi as ca

from identify.numerics import wide

FLAGS = ("-ffp-contract=off", "-fPIC", "-shared")
# How the compiler is asked, quick and plain first: by name, its flag, the seconds it takes per instruction, and the
# largest number of instructions. Plain code is some five times as fast as the virtual machine, improved code fifteen,
# and for several lanes at once forty-five.
LEVELS = {"plain": ("-O0", 3e-5, 200_000), "improved": ("-O1", 1.5e-4, 90_000), "wide": ("-O1", 1.5e-4, 90_000)}
STALE = 900.0  # seconds after which another process's unfinished work is taken for dead
# Compiles every folder given, one after the other. A finished library appears under its name at once or not at all;
# the lock goes whatever happens.
# It stays in the session of this process: Linux shares processors among sessions first, and nice counts in one only.
# Hardly nicer than the fit: that is ten times as fast once its functions are compiled.
SCRIPT = """
trap '' HUP
for work in "$@"; do
  name=$(cat "$work/name")
  nice -n 3 "$CC" $(cat "$work/flag") $FLAGS -o "$work/function.so" "$work/function.c" -lm &&
    mv "$work/function.so" "$CACHE/$name.so"
  rm -rf "$work" "$CACHE/$name.lock"
done
"""

# One compiling process at a time; it goes on when this one ends.
_running: list[subprocess.Popen[bytes]] = []


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
        found = base.stat()
        foreign = hasattr(os, "getuid") and found.st_uid != os.getuid()
        return (
            None if foreign or found.st_mode & (stat.S_IWOTH | stat.S_IWGRP) or not os.access(base, os.W_OK) else base
        )
    except (OSError, RuntimeError):  # no home, or one that cannot be written to
        return None


@cache
def _translator() -> str:
    """What besides the function decides about the machine code: compiler, its version, flags, CasADi, processor."""
    path = Path(compiler() or "/").resolve()
    lanes, flag = wide.register()
    written = [f"{wide.WRITTEN} {lanes} {flag}", ca.__version__, platform.machine()]
    return "\n".join([str(path), str(path.stat().st_mtime_ns), *FLAGS, *written])


def keys(function: ca.Function, *, lanes: bool = False) -> tuple[str, ...]:
    """What the function computes as a hash, with the level at which it would be compiled before it: one key for every
    level, the quick one first; none where nothing is compiled here.

    Args:
        lanes: the best code takes several lanes at once, as many as `wide.lanes_of` says.
    """
    size = function.n_instructions()
    if compiler() is None or folder() is None:
        return ()
    other = "improved" if lanes else "wide"
    levels = [name for name, (_, _, largest) in LEVELS.items() if size <= largest and name != other]
    computes = hashlib.sha256((_translator() + function.serialize()).encode()).hexdigest()[:40] if levels else ""
    return tuple(f"{name}-{computes}" for name in levels)


def key(function: ca.Function, *, lanes: bool = False) -> str | None:
    """The key of its best machine code; lanes as in `keys`."""
    return next(reversed(keys(function, lanes=lanes)), None)


def seconds(function: ca.Function, identity: str) -> float:
    """What compiling it takes, roughly."""
    return LEVELS[_level(identity)][1] * float(function.n_instructions())


def _level(identity: str) -> str:
    return identity.partition("-")[0]


def find(identity: str, name: str) -> ca.Function | None:
    """The compiled function of this key and name, or None where there is none yet."""
    base = folder()
    path = base / f"{identity}.so" if base else None
    if path is None or not path.is_file():
        return None
    try:
        return ca.external(name, str(path))
    except RuntimeError:  # damaged: as if it were not there
        path.unlink(missing_ok=True)
        return None


def busy() -> bool:
    """Whether a compilation started here is still running."""
    _running[:] = [process for process in _running if process.poll() is None]
    return bool(_running)


def wait() -> None:
    """Until what was started here is compiled; for tests and timings."""
    for process in _running:
        process.wait()
    _running.clear()


def start(jobs: Sequence[tuple[ca.Function, str]]) -> None:
    """Start compiling functions under their keys in the background, those that no other process is at."""
    base, cc = folder(), compiler()
    if base is None or cc is None:
        return
    try:
        works = [work for function, identity in jobs if (work := _prepared(base, function, identity)) is not None]
        if works:
            environment = os.environ | {"CC": cc, "FLAGS": " ".join(FLAGS), "CACHE": str(base)}
            quiet = subprocess.DEVNULL
            command = ["sh", "-c", SCRIPT, "compile", *(str(work) for work in works)]
            _running.append(
                subprocess.Popen(command, env=environment, stdin=quiet, stdout=quiet, stderr=quiet, process_group=0)
            )
    except OSError:  # the disk is full, say: the virtual machine goes on
        return


def _prepared(base: Path, function: ca.Function, identity: str) -> Path | None:
    """A folder with the C code, or None where another process has claimed the work."""
    lock = base / f"{identity}.lock"
    if lock.exists() and time.time() - lock.stat().st_mtime > STALE:
        lock.unlink(missing_ok=True)
    try:
        lock.touch(exist_ok=False)
    except FileExistsError:
        return None
    work = Path(tempfile.mkdtemp(prefix="build-", dir=base))
    (work / "name").write_text(identity, encoding="ascii")
    flag = LEVELS[_level(identity)][0]
    lanes, more = wide.register()
    code = wide.code(function, lanes) if _level(identity) == "wide" else None
    if code is not None:
        flag = f"{flag} {more}"
        (work / "function.c").write_text(code, encoding="ascii")
    else:
        generator = ca.CodeGenerator("function.c")
        generator.add(function)
        generator.generate(f"{work}{os.sep}")
    (work / "flag").write_text(flag, encoding="ascii")
    return work
