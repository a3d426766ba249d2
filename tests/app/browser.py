"""A headless browser, driven through its DevTools protocol."""

import base64
import contextlib
import io
import json
import shutil
import subprocess
import time
import urllib.request

import imageio.v3 as iio
import pytest

NAMES = "chromium", "chromium-browser", "google-chrome"
PATIENCE = 120  # seconds; on two busy cores without a GPU, a page takes half a minute


class Tab:
    """An open page."""

    def __init__(self, socket):
        self.socket, self.number, self.errors = socket, 0, []

    def call(self, method, **params):
        self.number += 1
        self.socket.send(json.dumps({"id": self.number, "method": method, "params": params}))
        while True:
            said = json.loads(self.socket.recv(timeout=PATIENCE))
            if said.get("method") == "Runtime.exceptionThrown":
                self.errors.append(said["params"]["exceptionDetails"]["text"])
            if said.get("id") == self.number:
                return said["result"]

    def picture(self):
        """Return a screenshot of the page, (H, W, 3)."""
        data = self.call("Page.captureScreenshot", format="png")["data"]
        return iio.imread(io.BytesIO(base64.b64decode(data)), extension=".png")[..., :3]

    def until(self, condition, seconds=PATIENCE):
        """Look at the page until it meets a condition, and return what it shows."""
        end = time.monotonic() + seconds
        while not condition(seen := self.picture()):
            assert time.monotonic() < end, self.errors
            time.sleep(0.2)
        return seen


@contextlib.contextmanager
def opened(address, folder):
    """Yield a tab with the page at an address; skip the test where there is no browser."""
    connect = pytest.importorskip("websockets.sync.client").connect
    browser = next(filter(None, map(shutil.which, NAMES)), None)
    if browser is None:
        pytest.skip("there is no browser")
    words = ["--headless=new", "--no-sandbox", "--use-angle=swiftshader", "--window-size=900,600",
             "--enable-unsafe-swiftshader", "--remote-debugging-port=0",
             f"--user-data-dir={folder}", "about:blank"]  # fmt: skip
    process = subprocess.Popen(
        [browser, *words], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    try:
        port = folder / "DevToolsActivePort"
        end = time.monotonic() + PATIENCE
        while not port.exists() or not port.read_text().strip():
            assert time.monotonic() < end
            assert process.poll() is None
            time.sleep(0.1)
        number = port.read_text().split()[0]
        with urllib.request.urlopen(f"http://127.0.0.1:{number}/json/list") as stream:
            target = next(t for t in json.load(stream) if t["type"] == "page")
        with connect(target["webSocketDebuggerUrl"], max_size=None) as socket:
            tab = Tab(socket)
            tab.call("Runtime.enable")
            tab.call("Page.enable")
            tab.call("Page.navigate", url=address)
            while json.loads(socket.recv(timeout=PATIENCE)).get("method") != "Page.loadEventFired":
                pass
            yield tab
    finally:
        process.kill()
        process.wait()
