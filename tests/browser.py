"""Pages in a real browser, where there is one."""

import html
import json
import re
import shutil
import subprocess

import pytest

CHROMIUM = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None
)
needs_browser = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium on this machine")


def run_in_page(page, script, folder):
    """Load a page from a file in headless Chromium, run the body of an async function in it, give what it returns."""
    driver = (
        f'<script>(async () => {{{script}}})().then((value) => {{ const result = document.createElement("output");'
        ' result.id = "result"; result.textContent = JSON.stringify(value); document.body.append(result); });</script>'
    )
    driven = folder / "driven.html"
    driven.write_text(page.replace("</body>", driver + "</body>"), encoding="utf-8")
    command = [
        str(CHROMIUM), "--headless", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage",
        "--disable-background-networking", "--disable-component-update", "--disable-sync", "--no-first-run",
        f"--user-data-dir={folder / 'profile'}", "--virtual-time-budget=15000", "--dump-dom", driven.as_uri(),
    ]  # fmt: skip
    finished = subprocess.run(command, capture_output=True, text=True, timeout=300, check=True)
    found = re.search(r'<output id="result">(.*?)</output>', finished.stdout, re.DOTALL)
    assert found, finished.stdout[-2000:] + finished.stderr[-2000:]
    return json.loads(html.unescape(found[1]))
