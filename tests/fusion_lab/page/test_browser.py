"""The lab in a real browser: it starts, every control changes what it should, nothing is asked of any other machine."""

import os
import re
import shutil
import signal
import socket
import subprocess
import sys
from pathlib import Path
from urllib.parse import urlparse

import pytest

from tests.fixtures.untrained_run import write_run

ROOT = Path(__file__).resolve().parents[3]
CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
pytest.importorskip("nicegui", reason="the extra is not installed: python -m pip install -e '.[lab]'")
sync_api = pytest.importorskip(
    "playwright.sync_api", reason="Playwright is not installed: python -m pip install -e '.[lab-test]'"
)
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(CHROMIUM is None, reason="there is no chromium here: apt-get install chromium"),
]
START, ANSWER = 240, 30_000
"""Seconds until the lab listens, scenes and compiled kernels included; milliseconds until an answer."""


@pytest.fixture(scope="module")
def address(tmp_path_factory):
    folder = tmp_path_factory.mktemp("lab")
    run = write_run(folder / "run")
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    command = [
        sys.executable,
        "-m",
        "fusion_lab",
        f"run={run}",
        f"port={port}",
        "show=false",
        f"data.root={folder / 'scenes'}",
    ]
    with (folder / "log").open("w") as log:
        lab = subprocess.Popen(
            [*command, "scenes=2", "keyframes=3"], cwd=ROOT, stdout=subprocess.PIPE, stderr=log, text=True,
            env=os.environ | {"PYTHONPATH": str(ROOT)},
        )  # fmt: skip
        for line in lab.stdout:
            if found := re.search(r"http://\S+", line):
                break
        else:
            pytest.fail((folder / "log").read_text())
        yield found.group()
        lab.send_signal(signal.SIGINT)
        lab.wait(timeout=30)
    assert "Traceback" not in (folder / "log").read_text()


@pytest.fixture(scope="module")
def browser():
    with sync_api.sync_playwright() as playwright:
        yield playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])


@pytest.fixture
def context(browser):
    """Tabs that may talk to this machine alone."""
    context, asked = browser.new_context(viewport={"width": 1440, "height": 1000}), []
    context.on("request", lambda request: asked.append(request.url))
    context.on("page", lambda page: page.on("websocket", lambda ws: asked.append(ws.url)))
    wrong = []
    context.on("weberror", lambda error: wrong.append(str(error.error)))
    context.on("console", lambda message: wrong.append(message.text) if message.type == "error" else None)
    yield context
    context.close()
    assert {urlparse(url).hostname for url in asked if urlparse(url).scheme not in ("data", "blob")} == {"127.0.0.1"}
    assert not wrong


def settle(page):
    """Waits until what is shown is what is set."""
    page.locator('[data-testid=status][data-settled="true"]').wait_for(timeout=ANSWER)


def opened(context, address, query=""):
    page = context.new_page()
    page.goto(f"{address}/{query}")
    settle(page)
    return page


def test_(address, context):
    page = opened(context, address)
    page.screenshot(path="/work/scratch/lab/wide.png", full_page=True)
    page.set_viewport_size({"width": 390, "height": 844})
    page.wait_for_timeout(500)
    page.screenshot(path="/work/scratch/lab/narrow.png", full_page=True)
