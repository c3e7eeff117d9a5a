"""A page in headless Chromium, with a real mouse: its DevTools protocol, spoken over two pipes."""

import json
import os
import shutil
import subprocess
import time
from pathlib import Path
from types import TracebackType
from typing import Any

NAMES = ("chromium", "chromium-browser", "google-chrome")
OPTIONS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--no-first-run",
    "--disable-background-networking", "--window-size=1400,1000", "--remote-debugging-pipe",
)  # fmt: skip
LOADED_WITHIN = 120.0
"""[s]"""


class Page:
    """A page that is open in a browser of its own."""

    def __init__(self, text: str, folder: Path) -> None:
        """Open a page.

        Args:
            text: Of the page.
            folder: For the page and the browser's profile.

        Raises:
            FileNotFoundError: If there is no Chromium.
        """
        found = next(filter(None, map(shutil.which, NAMES)), None)
        if found is None:
            raise FileNotFoundError("no Chromium on this machine; install one")
        path = folder / "page.html"
        path.write_text(text, encoding="utf-8")
        (from_us, self._to), (self._from, to_us) = os.pipe(), os.pipe()
        # Chromium reads from descriptor 3 and writes to 4.
        script = f'exec "$@" 3<&{from_us} 4>&{to_us}'
        command = [
            "bash",
            "-c",
            script,
            "bash",
            found,
            *OPTIONS,
            f"--user-data-dir={folder / 'profile'}",
        ]
        self._process = subprocess.Popen(
            command, pass_fds=(from_us, to_us), stderr=subprocess.DEVNULL
        )
        os.close(from_us)
        os.close(to_us)
        self._rest = b""
        self._number = 0
        self._session: str | None = None
        target = self._ask("Target.createTarget", url=path.as_uri())["targetId"]
        attached = self._ask("Target.attachToTarget", targetId=target, flatten=True)
        self._session = attached["sessionId"]
        begun = time.monotonic()
        while not self.evaluate(
            "location.href != 'about:blank' && document.readyState == 'complete'"
        ):
            if time.monotonic() - begun > LOADED_WITHIN:
                raise TimeoutError(f"{path} isn't loaded after {LOADED_WITHIN:g} s")
            time.sleep(0.1)

    def __enter__(self) -> "Page":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        value: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close the browser."""
        self._process.kill()
        self._process.wait()
        os.close(self._to)
        os.close(self._from)

    def evaluate(self, expression: str) -> Any:
        """The value of an expression in the page.

        Raises:
            RuntimeError: If it fails there.
        """
        answer = self._ask("Runtime.evaluate", expression=expression, returnByValue=True)
        if "exceptionDetails" in answer:
            raise RuntimeError(f"{expression}: {answer['exceptionDetails']}")
        return answer["result"].get("value")

    def click(self, x: float, y: float) -> None:
        """Move the mouse to a place of the window [px], press and release it."""
        self._ask("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y)
        for kind in ("mousePressed", "mouseReleased"):
            self._ask("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=1)

    def _ask(self, method: str, **values: Any) -> dict[str, Any]:
        """Send a command and wait for its answer; what the browser tells besides is dropped."""
        self._number += 1
        message: dict[str, Any] = {"id": self._number, "method": method, "params": values}
        if self._session is not None:
            message["sessionId"] = self._session
        os.write(self._to, json.dumps(message).encode() + b"\0")
        while True:
            while b"\0" not in self._rest:
                self._rest += os.read(self._from, 1 << 16)
            head, _, self._rest = self._rest.partition(b"\0")
            answer = json.loads(head)
            if answer.get("id") == self._number:
                if "error" in answer:
                    raise RuntimeError(f"{method}: {answer['error']}")
                result: dict[str, Any] = answer["result"]
                return result
