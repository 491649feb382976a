"""A served page driven in a headless Chromium as a person would: ask it, wait for it, click, type and drag."""

import json
import time

from tests.support.browser import PATIENCE, Browser


class PageBrowser(Browser):
    def size(self, width, height, dark=False):
        self.call(
            "Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=width < 600
        )
        scheme = [{"name": "prefers-color-scheme", "value": "dark" if dark else "light"}]
        self.call("Emulation.setEmulatedMedia", features=scheme)

    def visit(self, address):
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
            raise AssertionError(f"never: {expression}\n{self.ask(text)}\n{self.errors}") from None

    def press(self, words):
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

    @staticmethod
    def _until(look, complaint, patience=PATIENCE):
        deadline, pause = time.monotonic() + patience, 0.02
        while time.monotonic() < deadline:
            if found := look():
                return found
            time.sleep(pause)
            pause = min(1.2 * pause, 0.5)  # what takes long is asked for seldom
        raise AssertionError(complaint)


def _selector(words):
    return words.startswith(("#", "[", "."))
