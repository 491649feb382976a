"""A headless Chromium driven by its DevTools protocol: open a page, ask it, click and drag, look at it."""

import base64
import json
import shutil
import subprocess
import tempfile
import time
import urllib.request
from pathlib import Path

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
QUIET = (
    "--headless --no-sandbox --disable-gpu --disable-quic --no-first-run --disable-background-networking "
    "--disable-component-update --disable-sync --remote-debugging-port=0 --remote-allow-origins=*"
).split()
# every name but the server's own fails to resolve: a page that fetched anything from the network would show it
NO_NETWORK = "--host-resolver-rules=MAP * ~NOTFOUND , EXCLUDE 127.0.0.1"
PATIENCE = 60.0  # seconds for something to appear


class Browser:
    def __init__(self, width=1280, height=900):
        from websockets.sync.client import connect

        self.home = tempfile.mkdtemp(prefix="chromium-")
        words = [CHROMIUM, *QUIET, NO_NETWORK, f"--user-data-dir={self.home}", f"--window-size={width},{height}"]
        self.process = subprocess.Popen([*words, "about:blank"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        port = self._until(lambda: self._port(), "Chromium did not start")
        pages = json.load(urllib.request.urlopen(f"http://127.0.0.1:{port}/json"))
        page = next(p for p in pages if p["type"] == "page")
        self.socket = connect(page["webSocketDebuggerUrl"], max_size=None, ping_interval=None)
        self.number, self.complaints, self.asked = 0, [], []
        for domain in ("Page", "Runtime", "Network", "Log"):
            self.call(f"{domain}.enable")
        self.size(width, height)

    def _port(self):
        path = Path(self.home) / "DevToolsActivePort"
        return int(path.read_text().split()[0]) if path.exists() and path.read_text().strip() else None

    @staticmethod
    def _until(look, complaint, patience=PATIENCE):
        deadline = time.monotonic() + patience
        while time.monotonic() < deadline:
            if found := look():
                return found
            time.sleep(0.03)
        raise AssertionError(complaint)

    def call(self, method, **params):
        self.number += 1
        self.socket.send(json.dumps({"id": self.number, "method": method, "params": params}))
        while True:
            told = json.loads(self.socket.recv(timeout=PATIENCE))
            if told.get("id") == self.number:
                assert "error" not in told, told
                return told["result"]
            self._hear(told)

    def _hear(self, told):
        what, params = told.get("method"), told.get("params", {})
        if what == "Runtime.exceptionThrown":
            details = params["exceptionDetails"]
            self.complaints.append(details.get("exception", {}).get("description") or details["text"])
        elif what == "Log.entryAdded" and params["entry"]["level"] == "error":
            self.complaints.append(f"{params['entry']['text']} {params['entry'].get('url', '')}")
        elif what == "Network.requestWillBeSent":
            self.asked.append(params["request"]["url"])

    def size(self, width, height, dark=False):
        self.call(
            "Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=width < 600
        )
        scheme = [{"name": "prefers-color-scheme", "value": "dark" if dark else "light"}]
        self.call("Emulation.setEmulatedMedia", features=scheme)

    def open(self, address):
        self.call("Page.navigate", url="about:blank")
        self.call("Page.navigate", url=address)
        self.wait("document.body && document.body.dataset.ready === 'yes'")

    def ask(self, expression):
        found = self.call("Runtime.evaluate", expression=expression, awaitPromise=True, returnByValue=True)
        assert "exceptionDetails" not in found, found["exceptionDetails"]
        return found["result"].get("value")

    def wait(self, expression, patience=PATIENCE):
        def look():
            return self.ask(f"(() => {{ try {{ return Boolean({expression}); }} catch (e) {{ return false; }} }})()")

        text = "document.body ? document.body.innerText.slice(0, 1500) : ''"
        try:
            self._until(look, expression, patience)
        except AssertionError:
            raise AssertionError(f"never: {expression}\n{self.ask(text)}\n{self.complaints}") from None

    def click(self, words):
        """Press the button or link with these words, or the element of a selector."""
        target = json.dumps(words)
        find = f"[...document.querySelectorAll('button, a, summary')].find((b) => b.textContent.trim() === {target})"
        self.wait(f"{find} || document.querySelector({target})" if _selector(words) else find)
        self.ask(f"({find} || {f'document.querySelector({target})' if _selector(words) else 'null'}).click()")

    def type(self, selector, text):
        """Replace what a field holds, as a person does who then leaves it."""
        tell = "for (const kind of ['input', 'change']) field.dispatchEvent(new Event(kind, {bubbles: true}));"
        find = f"const field = document.querySelector({json.dumps(selector)}); field.focus();"
        self.wait(f"document.querySelector({json.dumps(selector)})")
        self.ask(f"(() => {{ {find} field.value = {json.dumps(text)}; {tell} }})()")

    def drag(self, selector, begin, end, steps=6):
        """Press, move and release the mouse; begin, end: shares (x, y) of the element."""
        find = f"const e = document.querySelector({json.dumps(selector)}); e.scrollIntoView({{block: 'center'}});"
        edges = "const r = e.getBoundingClientRect(); return [r.left, r.top, r.width, r.height];"
        rect = self.ask(f"(() => {{ {find} {edges} }})()")
        places = [(rect[0] + x * rect[2], rect[1] + y * rect[3]) for x, y in (begin, end)]
        self._mouse("mouseMoved", *places[0], 0)
        self._mouse("mousePressed", *places[0], 1)
        for i in range(1, steps + 1):
            self._mouse("mouseMoved", *(a + (b - a) * i / steps for a, b in zip(*places, strict=True)), 1)
        self._mouse("mouseReleased", *places[1], 0)

    def _mouse(self, kind, x, y, buttons):
        self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", buttons=buttons, clickCount=1)

    def picture(self, path):
        Path(path).write_bytes(
            base64.b64decode(self.call("Page.captureScreenshot", captureBeyondViewport=False)["data"])
        )

    def close(self):
        self.socket.close()
        self.process.terminate()
        self.process.wait(10)
        shutil.rmtree(self.home, ignore_errors=True)


def _selector(words):
    return words.startswith(("#", "[", "."))
