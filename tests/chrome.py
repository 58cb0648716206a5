"""A headless chromium that is driven over a pipe, by its DevTools protocol."""

import base64
import json
import os
import select
import shutil
import subprocess
import time

BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser"))), None)
FLAGS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--enable-unsafe-swiftshader",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)

PATIENCE = 240  # seconds: other tests may keep the machine busy
HINTS = ("GPU stall", "willReadFrequently", "no longer repeat")  # of drawing without a GPU


class Chrome:
    """One page.

    Attributes:
        said: Errors and warnings of the console, and what could not be loaded.
        asked: Addresses that were asked for.
    """

    def __init__(self, folder, url):
        there, self._out = os.pipe()
        self._in, back = os.pipe()

        def ends():  # chromium reads from 3 and writes to 4
            a, b = os.dup(there), os.dup(back)
            a, b = os.dup2(os.dup(a), 60), os.dup2(os.dup(b), 61)
            os.dup2(60, 3)
            os.dup2(61, 4)

        environment = os.environ | {"DBUS_SESSION_BUS_ADDRESS": "disabled:"}
        self._process = subprocess.Popen(
            [
                BROWSER,
                *FLAGS,
                "--remote-debugging-pipe",
                f"--user-data-dir={folder}",
                "--window-size=1500,950",
            ],
            preexec_fn=ends,
            close_fds=False,
            stderr=subprocess.DEVNULL,
            env=environment,
        )
        os.close(there)
        os.close(back)
        self._number, self._rest, self._session = 0, b"", None
        self.said, self.asked = [], []
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        found = self.call("Target.attachToTarget", targetId=target, flatten=True)
        self._session = found["sessionId"]
        for domain in ("Runtime", "Log", "Page", "Network"):
            self.call(f"{domain}.enable")
        self.call("Page.navigate", url=url)

    def call(self, method, **given):
        self._number += 1
        mine, message = self._number, {"id": self._number, "method": method, "params": given}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._out, json.dumps(message).encode() + b"\0")
        deadline = time.monotonic() + 2 * PATIENCE
        while True:
            while b"\0" not in self._rest:
                assert select.select([self._in], [], [], max(0, deadline - time.monotonic()))[0]
                self._rest += os.read(self._in, 1 << 20)
            one, _, self._rest = self._rest.partition(b"\0")
            found = json.loads(one)
            self._see(found.get("method"), found.get("params"))
            if found.get("id") == mine:
                assert "error" not in found, found
                return found["result"]

    def _see(self, method, given):
        if method == "Runtime.consoleAPICalled" and given["type"] in ("error", "warning"):
            self.said.append(str([a.get("value", a.get("description")) for a in given["args"]]))
        if method == "Log.entryAdded" and given["entry"]["level"] in ("error", "warning"):
            self.said.append(given["entry"]["text"] + " " + given["entry"].get("url", ""))
        if method == "Runtime.exceptionThrown":
            self.said.append(str(given["exceptionDetails"]))
        if method == "Network.requestWillBeSent":
            self.asked.append(given["request"]["url"])

    def run(self, script):
        """The value of an expression of JavaScript, which may be a promise."""
        found = self.call(
            "Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True
        )
        assert "exceptionDetails" not in found, found
        return found["result"].get("value")

    def until(self, script, seconds=PATIENCE):
        """Wait until an expression is true."""
        return self.run(
            f"new Promise((yes, no) => {{const end = performance.now() + {1000 * seconds};"
            f"const look = () => {{let found; try {{found = {script}}} catch (e) {{}}"
            "if (found) yes(found); else if (performance.now() > end) no('too late');"
            "else setTimeout(look, 5)}; look()})"
        )

    def shoot(self, path):
        found = self.call("Page.captureScreenshot", format="png")
        path.write_bytes(base64.b64decode(found["data"]))

    def close(self):
        os.close(self._out)
        self._process.terminate()
        self._process.wait(30)
        os.close(self._in)
