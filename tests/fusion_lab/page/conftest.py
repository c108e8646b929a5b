"""The lab as a process of its own, and a browser that may talk to nobody else."""

from urllib.parse import urlparse

import pytest

from tests.fixtures.lab_server import CHROMIUM, serving
from tests.fixtures.untrained_run import write_run


@pytest.fixture(scope="session")
def address(tmp_path_factory):
    folder = tmp_path_factory.mktemp("lab")
    run = write_run(folder / "run", "experiment=small")
    with serving(folder, f"run={run}", "data.num_scenes=2", "data.keyframes=3") as address:
        yield address
    log = (folder / "log").read_text()
    assert "Traceback" not in log
    assert "deleted" not in log  # nothing was sent to a tab that is closed


@pytest.fixture(scope="module")
def browser():
    from playwright.sync_api import sync_playwright  # an extra

    with sync_playwright() as playwright:
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
