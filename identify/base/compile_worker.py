"""Compiles C files one after the other: a process of its own, with nothing but the standard library.

`native.start` runs `python compile_worker.py CACHE COMPILER OPTION… -- BUILD…`: every BUILD is a folder
`build-<identity>` in CACHE with a function.c in it. The library appears in the cache at once or not at all, its
checksum in its name; `<identity>.failed` where the compiler has none. The process outlives the one it serves, which may
be shorter than a compilation. No compilation takes more than a minute of the processor, so that none goes on for ever,
and no build folder is left behind, also at SIGTERM.
"""

import hashlib
import os
import shutil
import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

LONGEST = 60  # seconds of the processor that one compilation may take


def library_name(identity: str, data: bytes) -> str:
    """The file name of a library of these bytes."""
    return f"{identity}.{hashlib.sha256(data).hexdigest()[:16]}.so"


def main(cache: str, *rest: str) -> None:
    """Compile all; the arguments are those of the module's docstring."""
    command, builds = rest[: rest.index("--")], [Path(build) for build in rest[rest.index("--") + 1 :]]
    signal.signal(signal.SIGTERM, lambda *_: sys.exit())
    import resource  # not there on Windows, where nothing is compiled

    os.nice(10)
    resource.setrlimit(resource.RLIMIT_CPU, (LONGEST, LONGEST))  # of the compiler's own processes as well
    try:
        for build in builds:
            identity, library = build.name.removeprefix("build-"), build / "function.so"
            words: list[str | Path] = [*command, "-o", library, build / "function.c", "-lm"]
            environment = os.environ | {"TMPDIR": str(build)}
            try:
                with suppress(OSError):  # no room: another time
                    subprocess.run(words, check=True, env=environment)
                    with library.open("rb+") as written:
                        data = written.read()
                        os.fsync(written.fileno())
                    library.replace(Path(cache) / library_name(identity, data))
            except subprocess.CalledProcessError:
                (Path(cache) / f"{identity}.failed").touch()
    finally:
        for build in builds:
            shutil.rmtree(build, ignore_errors=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
