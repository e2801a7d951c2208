"""A page in headless Chromium over its debugging protocol; there is no such browser on every machine."""

from __future__ import annotations

import itertools
import json
import shutil
import subprocess
import tempfile
import time
import urllib.request
from pathlib import Path
from typing import Any

from websockets.sync.client import connect

PROGRAM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
_FLAGS = (
    "--headless=new",
    "--no-sandbox",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-background-networking",
    "--no-first-run",
    "--remote-debugging-port=0",
)


class Chromium:
    """One tab. ``said`` holds what the page printed, threw or asked the network for since it was opened."""

    def __init__(self) -> None:
        self._profile = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
        self._process = subprocess.Popen(
            [str(PROGRAM), *_FLAGS, f"--user-data-dir={self._profile.name}", "about:blank"],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        port = _port(Path(self._profile.name) / "DevToolsActivePort")
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/json") as answer:
            tabs = json.load(answer)
        address = next(tab["webSocketDebuggerUrl"] for tab in tabs if tab["type"] == "page")
        self._connection = connect(address, max_size=None)
        self._socket = self._connection.__enter__()
        self._numbers, self._events = itertools.count(1), []
        for domain in ("Page", "Runtime", "Log", "Network"):
            self._call(f"{domain}.enable")

    def _call(self, method: str, **parameters: Any) -> dict[str, Any]:
        number = next(self._numbers)
        self._socket.send(json.dumps({"id": number, "method": method, "params": parameters}))
        while True:
            message = json.loads(self._socket.recv(timeout=60.0))
            if message.get("id") == number:
                assert "error" not in message, message
                return message["result"]
            self._events.append(message)

    def ask(self, expression: str) -> Any:
        """What an expression of JavaScript, or its promise, comes to."""
        found = self._call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in found, found["exceptionDetails"]
        return found["result"].get("value")

    def open(self, page: Path, width: int, *, dark: bool = False, media: str = "") -> None:
        """Load a page in a window of that width [px]."""
        self._events.clear()
        self._call(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=800,
            deviceScaleFactor=1,
            mobile=width < 600,
        )
        self.look(dark=dark, media=media)
        self._call("Page.navigate", url=page.resolve().as_uri())
        self.wait("document.readyState === 'complete'")

    def look(self, *, dark: bool = False, media: str = "") -> None:
        """Change the reader's colours, and what the page is shown on."""
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self._call("Emulation.setEmulatedMedia", media=media, features=[scheme])

    def move_mouse(self, x: float, y: float) -> None:
        """Over a place in the window [px]."""
        for step in (2.0, 0.0):
            self._call("Input.dispatchMouseEvent", type="mouseMoved", x=x - step, y=y)

    def wait(self, expression: str, seconds: float = 60.0) -> None:
        """Until it is true."""
        end = time.monotonic() + seconds
        while not self.ask(expression):
            assert time.monotonic() < end, expression
            time.sleep(0.05)

    @property
    def said(self) -> list[str]:
        """Exceptions, lines on the console, and requests other than for the page itself."""
        self.ask("1")
        found = []
        for event in self._events:
            method, values = event["method"], event.get("params", {})
            if method == "Network.requestWillBeSent" and not values["request"]["url"].startswith("file:"):
                found.append(values["request"]["url"])
            elif method in {"Runtime.exceptionThrown", "Runtime.consoleAPICalled", "Log.entryAdded"}:
                found.append(json.dumps(values)[:500])
        return found

    def close(self) -> None:
        """End the browser."""
        self._connection.__exit__(None, None, None)
        self._process.terminate()
        self._process.wait()
        self._profile.cleanup()


def _port(file: Path) -> str:
    for _ in range(600):
        if file.exists() and len(file.read_text().split()) > 1:
            return file.read_text().split()[0]
        time.sleep(0.1)
    raise AssertionError("the browser did not start")
