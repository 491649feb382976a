"""`stickslip cache`: how much machine code is kept where, and its removal."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace

from identify.cli.common import Answer, Terminal

NAME = "cache"
HELP = "where compiled code is kept, and how much; --clear removes it"


def add_arguments(parser: ArgumentParser) -> None:
    """The arguments of this command."""
    parser.add_argument("--clear", action="store_true", help="remove all of it: it is made again when it is needed")


def run(arguments: Namespace, terminal: Terminal) -> Answer:
    """Say what is kept; remove it where that is asked for."""
    from identify.base import native

    base = native.folder()
    if base is None:
        terminal.say("no folder for compiled code can be used here, so none is kept; STICKSLIP_CACHE names another one")
        return Answer(document={"status": "done", "folder": None, "files": 0, "bytes": 0})
    files = native.contents(base)
    size = sum(held for _, held, _ in files)
    if arguments.clear:
        for _, _, path in files:
            path.unlink(missing_ok=True)
        terminal.say(f"{base}: {len(files)} files removed, {1e-6 * size:.1f} MB")
    else:
        terminal.say(f"{base}: {len(files)} files, {1e-6 * size:.1f} MB of at most {1e-6 * native.limit():.0f} MB")
        terminal.say(
            "--clear removes them; STICKSLIP_CACHE_MB sets another limit, STICKSLIP_COMPILE=0 compiles nothing"
        )
    document = {"status": "done", "folder": str(base), "files": len(files), "bytes": size, "limit": native.limit()}
    return Answer(document=document | {"cleared": arguments.clear})
