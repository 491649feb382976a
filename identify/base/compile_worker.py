"""Compiles C files one after the other: a process of its own, with nothing but the standard library.

`native.start` runs `python compile_worker.py CACHE LINGER COMPILER OPTION… -- BUILD…`: every BUILD is a folder
`build-<identity>` in CACHE with a function.c in it. The library appears in the cache at once or not at all, its
checksum in its name; `<identity>.failed` where there is none. The process ends LINGER seconds after its standard input
does (a pipe from the process it serves) or at SIGTERM, and leaves no build folder behind.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

LONGEST = 60  # seconds of processor time that one compilation may take


def library_name(identity: str, data: bytes) -> str:
    """The file name of a library of these bytes."""
    return f"{identity}.{hashlib.sha256(data).hexdigest()[:16]}.so"


def compile_in(build: Path, command: list[str], cache: Path) -> None:
    """Compile one folder and publish what comes of it."""
    identity, library = build.name.removeprefix("build-"), build / "function.so"
    try:
        environment = os.environ | {"TMPDIR": str(build)}
        subprocess.run([*command, "-o", library, build / "function.c", "-lm"], check=True, env=environment)
        with library.open("rb+") as written:
            data = written.read()
            os.fsync(written.fileno())
        library.replace(cache / library_name(identity, data))
    except (OSError, subprocess.SubprocessError):
        (cache / f"{identity}.failed").touch()
    shutil.rmtree(build, ignore_errors=True)


def main(cache: str, linger: str, *rest: str) -> None:
    """Compile all; the arguments are those of the module's docstring."""
    import resource  # there is none on Windows, where nothing is compiled

    command, builds = list(rest[: rest.index("--")]), [Path(build) for build in rest[rest.index("--") + 1 :]]

    def end_with_parent() -> None:
        sys.stdin.buffer.read()
        time.sleep(float(linger))
        os.killpg(0, signal.SIGTERM)

    for number in (signal.SIGTERM, signal.SIGHUP, signal.SIGINT):
        signal.signal(number, lambda *_: sys.exit())
    threading.Thread(target=end_with_parent, daemon=True).start()
    resource.setrlimit(resource.RLIMIT_CPU, (LONGEST, LONGEST))
    os.nice(10)
    try:
        for place, build in enumerate(builds):
            for waiting in builds[place:]:
                os.utime(waiting)  # not left behind: its turn comes
            compile_in(build, command, Path(cache))
    finally:
        for build in builds:
            shutil.rmtree(build, ignore_errors=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
