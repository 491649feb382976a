"""A headless Chromium driven over a pipe (DevTools protocol) as a person would: ask, wait, click, type, drag, look."""

from __future__ import annotations

import base64
import fcntl
import json
import os
import select
import shutil
import subprocess
import tempfile
import time
from pathlib import Path
from typing import Any

CHROMIUM = next(
    (found for name in ("chromium", "chromium-browser", "google-chrome") if (found := shutil.which(name))), None
)
PATIENCE = 60.0
QUIET = (
    "--headless=new --no-sandbox --disable-gpu --disable-quic --disable-dev-shm-usage --no-first-run "
    "--disable-background-networking --disable-component-update --disable-sync --remote-debugging-pipe"
).split()
# every name but the machine's own fails to resolve: a page that fetched anything from the network would show it
NO_NETWORK = "--host-resolver-rules=MAP * ~NOTFOUND , EXCLUDE 127.0.0.1"


class Browser:
    """One page in a headless browser; use as a context. `requests` and `errors` collect what the page did.

    The browser ends when its pipe does, so that a test that is killed leaves none behind.
    """

    def __init__(self) -> None:
        assert CHROMIUM is not None
        self._profile = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)  # it may still be written to
        to_child, from_us = os.pipe()
        to_us, from_child = os.pipe()
        self._in, self._out = from_us, to_us
        ends = [fcntl.fcntl(fd, fcntl.F_DUPFD, 10) for fd in (to_child, from_child)]  # out of the way of 3 and 4

        def at_three_and_four() -> None:
            os.dup2(ends[0], 3)
            os.dup2(ends[1], 4)

        self._process = subprocess.Popen(
            [CHROMIUM, *QUIET, NO_NETWORK, f"--user-data-dir={self._profile.name}", "about:blank"],
            pass_fds=(3, 4),
            preexec_fn=at_three_and_four,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        for fd in (to_child, from_child, *ends):
            os.close(fd)
        self._buffer, self._number, self._loaded = b"", 0, False
        self.requests: list[str] = []
        self.errors: list[str] = []
        self._session = ""
        targets = self.call("Target.getTargets")["targetInfos"]
        page = next(t["targetId"] for t in targets if t["type"] == "page")
        self._session = self.call("Target.attachToTarget", targetId=page, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Network", "Log"):
            self.call(f"{domain}.enable")

    def __enter__(self) -> Browser:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.terminate()
        try:
            self._process.wait(10)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait(10)
        os.close(self._in)
        os.close(self._out)
        self._profile.cleanup()

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """One command and its answer."""
        self._number += 1
        message: dict[str, Any] = {"id": self._number, "method": method, "params": parameters}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._in, json.dumps(message).encode() + b"\0")
        until = time.monotonic() + PATIENCE
        while True:
            answer = self._next(until)
            if answer.get("id") == self._number:
                assert "error" not in answer, answer["error"]
                return answer["result"]

    def _next(self, until: float) -> dict[str, Any]:
        while b"\0" not in self._buffer:
            ready, _, _ = select.select([self._out], [], [], max(until - time.monotonic(), 0.0))
            if not ready:
                raise TimeoutError("the browser does not answer")
            chunk = os.read(self._out, 1 << 20)
            if not chunk:
                raise RuntimeError("the browser has ended")
            self._buffer += chunk
        raw, _, self._buffer = self._buffer.partition(b"\0")
        message = json.loads(raw)
        self._note(message)
        return message

    def _note(self, message: dict[str, Any]) -> None:
        method, given = message.get("method"), message.get("params", {})
        if method == "Network.requestWillBeSent":
            self.requests.append(given["request"]["url"])
        elif method == "Runtime.exceptionThrown":
            details = given["exceptionDetails"]
            self.errors.append(str(details.get("exception", {}).get("description") or details["text"]))
        elif method == "Log.entryAdded" and given["entry"]["level"] == "error":
            self.errors.append(f"{given['entry']['text']} {given['entry'].get('url', '')}".strip())
        elif method == "Page.javascriptDialogOpening":
            self.errors.append(f"dialog: {given['message']}")
        elif method == "Page.loadEventFired":
            self._loaded = True

    def size(self, width: int, height: int = 900, dark: bool = False) -> None:
        """The size of the window [CSS pixels], and whether it is night."""
        self.call(
            "Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=width < 600
        )
        scheme = [{"name": "prefers-color-scheme", "value": "dark" if dark else "light"}]
        self.call("Emulation.setEmulatedMedia", features=scheme)

    def open(self, page: Path, width: int) -> None:
        """Open a page from disk at a width and wait until it is loaded."""
        self.size(width)
        self._loaded = False
        self.call("Page.navigate", url=page.resolve().as_uri())
        until = time.monotonic() + PATIENCE
        while not self._loaded:
            self._next(until)

    def visit(self, address: str) -> None:
        """Open a served page and wait until it says that it is ready."""
        self.call("Page.navigate", url="about:blank")
        self.call("Page.navigate", url=address)
        self.wait("document.body && document.body.dataset.ready === 'yes'")

    def ask(self, expression: str) -> Any:
        """The value of an expression in the page, promises waited for."""
        found = self.call("Runtime.evaluate", expression=expression, awaitPromise=True, returnByValue=True)
        assert "exceptionDetails" not in found, found["exceptionDetails"]
        return found["result"].get("value")

    def wait(self, expression: str, patience: float = PATIENCE) -> None:
        """Wait until an expression holds; what cannot be evaluated does not hold."""
        look = f"(() => {{ try {{ return Boolean({expression}); }} catch (e) {{ return false; }} }})()"
        deadline, pause = time.monotonic() + patience, 0.02
        while time.monotonic() < deadline:
            if self.ask(look):
                return
            time.sleep(pause)
            pause = min(1.2 * pause, 0.5)  # what takes long is asked for seldom
        shown = self.ask("document.body ? document.body.innerText.slice(0, 1500) : ''")
        raise AssertionError(f"never: {expression}\n{shown}\n{self.errors}")

    def press(self, words: str) -> None:
        """Press the button or link with these words, or the element of a selector."""
        target = json.dumps(words)
        find = f"[...document.querySelectorAll('button, a, summary')].find((b) => b.textContent.trim() === {target})"
        if words.startswith(("#", "[", ".")):
            find = f"({find} || document.querySelector({target}))"
        self.wait(find)
        self.ask(f"{find}.click()")

    def type(self, selector: str, text: str) -> None:
        """Replace what a field holds, as a person does who then leaves it."""
        tell = "for (const kind of ['input', 'change']) field.dispatchEvent(new Event(kind, {bubbles: true}));"
        find = f"const field = document.querySelector({json.dumps(selector)}); field.focus();"
        self.wait(f"document.querySelector({json.dumps(selector)})")
        self.ask(f"(() => {{ {find} field.value = {json.dumps(text)}; {tell} }})()")

    def drag(self, selector: str, begin: tuple[float, float], end: tuple[float, float], steps: int = 6) -> None:
        """Press, move and release the mouse; begin, end: shares (x, y) of the element."""
        find = f"const e = document.querySelector({json.dumps(selector)})"
        show = "e.scrollIntoView({block: 'center', behavior: 'instant'}); const r = e.getBoundingClientRect()"
        left, top, width, height = self.ask(f"(() => {{ {find}; {show}; return [r.x, r.y, r.width, r.height]; }})()")
        places = [(left + x * width, top + y * height) for x, y in (begin, end)]
        self._mouse("mouseMoved", *places[0], 0)
        self._mouse("mousePressed", *places[0], 1)
        for i in range(1, steps + 1):
            self._mouse("mouseMoved", *(a + (b - a) * i / steps for a, b in zip(*places, strict=True)), 1)
        self._mouse("mouseReleased", *places[1], 0)

    def click(self, selector: str) -> None:
        """A real click of the mouse in the middle of an element."""
        self.drag(selector, (0.5, 0.5), (0.5, 0.5), 0)

    def _mouse(self, kind: str, x: float, y: float, buttons: int) -> None:
        self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", buttons=buttons, clickCount=1)

    def picture(self, path: Path, height: int | None = None) -> None:
        """A PNG of the whole page, or of its first so many pixels."""
        size = self.call("Page.getLayoutMetrics")["cssContentSize"]
        clip = {"x": 0, "y": 0, "width": size["width"], "height": height or size["height"], "scale": 1}
        taken = self.call("Page.captureScreenshot", format="png", captureBeyondViewport=True, clip=clip)
        path.write_bytes(base64.b64decode(taken["data"]))
