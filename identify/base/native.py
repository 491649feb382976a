"""Functions as machine code: translated to C, compiled once, kept in the user's cache; nothing waits for it.

A function that has cost some time in CasADi's virtual machine is compiled in the background where a C compiler
exists, and found again by every later process through the hash of what it computes. The compiler keeps the order
of the arithmetic (no contraction, no fast-math), so both ways give the same numbers. A function that could not be
compiled leaves a mark in the cache, and no process tries it again for a day or until the compiler is another.

Compiling takes one core at low priority, less processor time than the process it serves has taken so far, and ends
`LINGER` seconds after that process at the latest, however it ended. The cache holds `LIMIT` bytes; what was not used
for longest goes first.

Environment: STICKSLIP_COMPILE=0 keeps the virtual machine; STICKSLIP_CACHE names another folder, STICKSLIP_CACHE_MB
another limit.
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
import time
import uuid
from collections.abc import Sequence
from contextlib import suppress
from functools import cache
from pathlib import Path

import casadi as ca

from identify.base import wide

FLAGS = ("-ffp-contract=off", "-fPIC", "-shared")
# How the compiler is asked, quick and plain first: by name, its flag, the seconds it takes per instruction, and the
# largest number of instructions. Plain code is some five times as fast as the virtual machine, improved code fifteen,
# and for several lanes at once forty-five.
LEVELS = {"plain": ("-O0", 3e-5, 200_000), "improved": ("-O1", 1.5e-4, 90_000), "wide": ("-O1", 1.5e-4, 90_000)}
STALE = 900.0  # seconds after which another process's unfinished work is taken for dead
AGAIN = 86_400.0  # seconds after which a function that could not be compiled is tried again
LINGER = 10  # seconds that compiling may go on after the process it serves: the next one finds it done
LIMIT = 64_000_000  # bytes of machine code that are kept
SLOWER = 2.0  # times what `LEVELS` tells, which a compilation is granted
# Compiles every folder given, one after the other; those that still wait are kept from looking dead. A finished library
# appears under its name at once or not at all, and a mark where there is none; the lock goes whatever happens.
# It stays in the session of this process: Linux shares processors among sessions first, and nice counts in one only.
# Its standard input is a pipe from this process: that ends when the process does, whatever ended it.
SCRIPT = """
exec 3<&0 </dev/null
(read -r nothing <&3; sleep "$LINGER"; kill -TERM 0) &
watch=$!
drop() { for work in "$@"; do name=$(cat "$work/name" 2>/dev/null) && rm -rf "$work" "$CACHE/$name.lock"; done; }
trap 'drop "$@"; exit 0' TERM HUP INT
for work in "$@"; do
  touch -c "$@"
  name=$(cat "$work/name") || continue
  (ulimit -t $(cat "$work/limit"); exec 3<&-
   exec nice -n 10 "$CC" $(cat "$work/flag") $FLAGS -o "$work/function.so" "$work/function.c" -lm) &&
    mv "$work/function.so" "$CACHE/$name.so" || touch "$CACHE/$name.failed"
  rm -rf "$work" "$CACHE/$name.lock"
done
trap '' TERM
kill -TERM 0
"""

# One compiling process at a time.
_running: list[subprocess.Popen[bytes]] = []
_granted: list[float] = []  # seconds of processor time, one number per compilation that was started here


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
    if base is None or not (path := base / f"{identity}.so").is_file():
        return None
    try:
        os.utime(path)  # used just now: the last to go where the cache is full
        return ca.external(name, str(path))
    except OSError:  # another process has just made room
        return None
    except RuntimeError:  # damaged, or nothing in this folder can be run: as if it could not be compiled
        path.unlink(missing_ok=True)
        _mark(base, identity)
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
    """Start compiling functions under their keys in the background, those that no other process is at or failed at, as
    long as all that was started here takes less processor time than this process has taken."""
    base, cc = folder(), compiler()
    if base is None or cc is None:
        return
    works: dict[str, Path] = {}
    for function, identity in jobs:
        needed = SLOWER * seconds(function, identity)
        if not failed(identity) and sum(_granted) + needed <= time.process_time() and _claimed(base, identity):
            _granted.append(needed)
            work = _prepared(base, function, identity)
            if work is not None:
                works[identity] = work
    if not works:
        return
    _sweep(base)
    make_room(base)
    environment = os.environ | {"CC": cc, "FLAGS": " ".join(FLAGS), "CACHE": str(base), "LINGER": str(LINGER)}
    quiet = subprocess.DEVNULL
    command = ["sh", "-c", SCRIPT, "compile", *(str(work) for work in works.values())]
    try:
        _running.append(
            subprocess.Popen(
                command, env=environment, stdin=subprocess.PIPE, stdout=quiet, stderr=quiet, process_group=0
            )
        )
    except OSError:  # no more processes, say: the virtual machine goes on
        for identity, work in works.items():
            _give_up(base, identity, work)


def _claimed(base: Path, identity: str) -> bool:
    """Whether the work is ours from now on: no other process is at it, and the cache can be written to."""
    lock = base / f"{identity}.lock"
    try:
        if _age(lock) > STALE:
            lock.unlink(missing_ok=True)
        lock.touch(exist_ok=False)
    except OSError:
        return False
    return True


def _prepared(base: Path, function: ca.Function, identity: str) -> Path | None:
    """A folder with the C code of work that was claimed, or None where it cannot be written: then it is given up."""
    work = base / f"build-{identity}-{uuid.uuid4().hex}"
    try:
        work.mkdir(mode=0o700)
        _write(work, function, identity)
    except (OSError, RuntimeError):  # the disk is full, say, or CasADi has no C for it
        _give_up(base, identity, work)
        return None
    return work


def _write(work: Path, function: ca.Function, identity: str) -> None:
    """Put into a folder what the script compiles: the C code, and under which name and with which flag."""
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
    (work / "limit").write_text(str(math.ceil(1.0 + SLOWER * seconds(function, identity))), encoding="ascii")


def _give_up(base: Path, identity: str, work: Path) -> None:
    """Leave nothing behind of work that was claimed but a mark that it failed."""
    _mark(base, identity)
    shutil.rmtree(work, ignore_errors=True)
    (base / f"{identity}.lock").unlink(missing_ok=True)


def _mark(base: Path, identity: str) -> None:
    with suppress(OSError):
        (base / f"{identity}.failed").touch()


def limit() -> int:
    """Bytes of machine code that are kept."""
    told = os.environ.get("STICKSLIP_CACHE_MB", "")
    return int(1e6 * float(told)) if told.replace(".", "", 1).isdigit() else LIMIT


def contents(base: Path) -> list[tuple[float, int, Path]]:
    """Every file of ours in the cache: when it was used last, its size in bytes, its path; the oldest first."""
    found = []
    for path in base.iterdir():
        if path.suffix in (".so", ".failed") and path.stem.partition("-")[0] in LEVELS:
            with suppress(OSError):
                about = path.stat()
                found.append((about.st_mtime, about.st_size, path))
    return sorted(found)


def make_room(base: Path) -> None:
    """Remove what was not used for longest until the cache holds no more than its limit."""
    files = contents(base)
    held = sum(size for _, size, _ in files)
    for _, size, path in files:
        if held <= limit():
            break
        path.unlink(missing_ok=True)
        held -= size


def _age(path: Path) -> float:
    """Seconds since a file or folder was changed; NaN where there is none: another process may just have removed it."""
    try:
        return time.time() - path.stat().st_mtime
    except OSError:
        return math.nan


def _sweep(base: Path) -> None:
    """Remove what dead processes left behind."""
    for work in base.glob("build-*"):
        if _age(work) > STALE:
            shutil.rmtree(work, ignore_errors=True)
