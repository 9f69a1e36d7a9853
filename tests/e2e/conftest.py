"""A browser, and the real server with the real simulator."""

import os
import re
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page

from tests.conftest import CHECKOUT, SHARED_DATA
from tests.e2e.chromium import chromium_path, open_chromium
from tests.e2e.watching import Complaints
from tests.server.running import START_S, TOKEN, Running, wait_for

VIEWPORT = {"width": 1000, "height": 640}


# Playwright's loop runs for as long as it is open: a module at a time, so that no other test finds a running loop.
@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    path = chromium_path()
    if path is None:
        pytest.skip("no Chromium: install it or point CHROMIUM at one")
    with open_chromium(path) as browser:
        yield browser


@dataclass
class Dashboard:
    """The served simulator, its page, and what the page complained of."""

    server: Running
    login_url: str
    page: Page
    complaints: Complaints


def start_dashboard(folder: Path) -> tuple[Running, str]:
    """Start ``snakeslam serve`` on a free port; return it and the one-time URL it printed."""
    config = CHECKOUT / "configs" / "sim.yaml"
    command = [sys.executable, "-m", "snakeslam", "serve", str(config), "--port", "0"]
    if SHARED_DATA.is_dir():
        command += ["--recordings", str(SHARED_DATA)]
    env = {**os.environ, "SNAKESLAM_TOKEN": TOKEN, "OPENBLAS_NUM_THREADS": "1"}
    process = subprocess.Popen(command, cwd=folder, env=env, stdout=subprocess.PIPE, text=True)
    running = Running(process, folder)
    while not (found := re.search(r"Open ((http://[^/]+)/login\S+)", running.next_line())):
        assert running.out[-1], "the server ended before it was ready"
    running.url = found.group(2)
    return running, found.group(1)


@pytest.fixture(scope="module")
def dashboard(browser: Browser, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Dashboard]:
    if not (CHECKOUT / "web" / "dist" / "index.html").is_file():
        pytest.fail("the page is not built: make setup")
    server, login_url = start_dashboard(tmp_path_factory.mktemp("dashboard"))
    try:
        with server.client() as client:
            wait_for(lambda: client.get("/api/v1/state").json()["session"] == "running", START_S)
        context = browser.new_context(viewport=VIEWPORT, reduced_motion="reduce")
        page = context.new_page()
        page.set_default_timeout(30_000)
        complaints = Complaints()
        complaints.watch(page, server.url.removeprefix("http://"))
        page.goto(login_url)
        yield Dashboard(server, login_url, page, complaints)
        context.close()
    finally:
        code = server.stop()
    assert code == 0
