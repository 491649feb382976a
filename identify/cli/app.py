"""`stickslip app`: the page to work in, served on this machine alone."""

from __future__ import annotations

from argparse import Namespace
from importlib.util import find_spec

from identify.cli.common import Answer, CommandLineError, Terminal
from identify.cli.interrupt import ends_by_itself

NEEDS = ("starlette", "uvicorn", "tomlkit")
CHECKED_AFTER = 0.5  # seconds between checks whether Ctrl-C was pressed


def serve(arguments: Namespace, terminal: Terminal) -> Answer:
    """Serve until Ctrl-C."""
    if missing := [name for name in NEEDS if find_spec(name) is None]:
        raise CommandLineError(
            f"the page needs {' and '.join(missing)}, which the extra `app` brings; install it with: "
            "pip install 'stick-slip-workbench[app]' (in a clone: pip install '.[app]')"
        )
    port = arguments.port or 0
    if not 0 <= port < 65536:
        raise CommandLineError(f"--port is {port}; expected 1024 to 65535, or leave it out")
    from identify.app.folder import Folder
    from identify.app.server import Serving

    ends_by_itself()
    try:
        serving = Serving(Folder.at(arguments.folder or "."), port)
    except OSError as error:
        raise CommandLineError(f"--port {port}: {error.strerror}; choose another or leave it out") from None
    serving.start()
    terminal.say(f"{serving.address}\nThe address is a key: whoever has it can work in {serving.page.folder.root}.")
    terminal.note("Ctrl-C stops the page; jobs that run go on, and the page finds them again.")
    try:
        if not arguments.no_browser:
            import webbrowser

            webbrowser.open(serving.door.as_uri())
        while serving.wait(CHECKED_AFTER):
            pass
    finally:
        serving.stop()
    return Answer(document={"status": "done"})
