"""A browser, and the real server with the real simulator."""

import os
import re
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from http import HTTPStatus
from pathlib import Path
from typing import Any

import httpx
import pytest
from playwright.sync_api import Browser, Page, expect

from tests.conftest import CHECKOUT, SHARED_DATA
from tests.e2e.chromium import chromium_path, open_chromium
from tests.e2e.watching import Complaints
from tests.server.running import START_S, TOKEN, Running, is_ready, wait_for

VIEWPORT = {"width": 1000, "height": 640}
# For a machine that is busy with other things too.
PATIENCE_MS = 40_000
# Two cores render the simulator's camera and the browser's page in software.
LIGHTER = "sim.camera.rate_hz=10"


# Playwright's loop runs for as long as it is open: a module at a time, so that no other test finds a running loop.
@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    path = chromium_path()
    if path is None:
        pytest.skip("no Chromium: install it or point CHROMIUM at one")
    expect.set_options(timeout=PATIENCE_MS)
    with open_chromium(path) as browser:
        yield browser


@dataclass
class Dashboard:
    """The served simulator, its page, and what the page complained of."""

    server: Running
    login_url: str
    page: Page
    complaints: Complaints
    lease_key: str = ""

    def take_control(self) -> str:
        """Have the page in control; return its lease's key, so that a script may act in its name."""
        with self.server.client() as client:
            for _ in range(3):
                key = self._lease()
                if client.put("/api/v1/control/lease", headers={"Control-Lease": key}).status_code == 200:
                    return key
        raise AssertionError("the page does not keep control: it draws too slowly to renew its lease")

    def _lease(self) -> str:
        if self.lease_key == "" or not self.page.locator("#control-release").is_visible():
            with self.page.expect_response("**/control/lease") as answer:
                self.page.locator("#control-take").click()
            self.lease_key = answer.value.json()["key"]
            expect(self.page.locator("#control-state")).to_have_text("You")
        return self.lease_key


def start_dashboard(folder: Path, *settings: str) -> tuple[Running, str]:
    """Start ``snakeslam serve`` on a free port; return it and the one-time URL it printed."""
    config = CHECKOUT / "configs" / "sim.yaml"
    command = [sys.executable, "-m", "snakeslam", "serve", str(config), "--port", "0"]
    command += [f"--set={setting}" for setting in settings]
    if SHARED_DATA.is_dir():
        command += ["--recordings", str(SHARED_DATA)]
    env = {**os.environ, "SNAKESLAM_TOKEN": TOKEN, "OPENBLAS_NUM_THREADS": "1", "XDG_STATE_HOME": str(folder)}
    process = subprocess.Popen(command, cwd=folder, env=env, stdout=subprocess.PIPE, text=True)
    running = Running(process, folder)
    while not (found := re.search(r"Open ((http://[^/]+)/login\S+)", running.next_line())):
        if not running.out[-1]:
            code = stop_dashboard(running)
            pytest.fail(f"the server ended with {code} before it was ready")
    running.url = found.group(2)
    return running, found.group(1)


def stop_dashboard(server: Running) -> int:
    """Stop the server and close its output."""
    code = server.stop()
    if server.process.stdout is not None:
        server.process.stdout.close()
    return code


def wait_until_running(server: Running) -> None:
    """Wait for a session that would move its robot; fail with its own words when it does."""
    with server.client() as client:
        state = wait_for(lambda: _settled(client.get("/api/v1/state").json()), START_S)
        assert state["session"] == "running", state["message"]
        wait_for(lambda: is_ready(client), START_S)


def start_moving(client: httpx.Client) -> None:
    """Start the gait; asked again while it is refused, as it is while a busy machine's camera or estimator is late."""

    def accepted() -> bool:
        answer = client.post("/api/v1/gait/start")
        if answer.status_code != HTTPStatus.CONFLICT:
            answer.raise_for_status()
        return answer.is_success

    wait_for(accepted, START_S)


def _settled(state: dict[str, Any]) -> dict[str, Any] | None:
    return None if state["session"] == "starting" else state


@pytest.fixture(scope="module")
def dashboard(browser: Browser, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Dashboard]:
    if not (CHECKOUT / "web" / "dist" / "index.html").is_file():
        pytest.fail("the page is not built: make setup")
    server, login_url = start_dashboard(tmp_path_factory.mktemp("dashboard"), LIGHTER)
    try:
        wait_until_running(server)
        context = browser.new_context(viewport=VIEWPORT, reduced_motion="reduce")
        page = context.new_page()
        page.set_default_timeout(PATIENCE_MS)
        complaints = Complaints()
        complaints.watch(page, server.url.removeprefix("http://"))
        page.goto(login_url)
        yield Dashboard(server, login_url, page, complaints)
        context.close()
    finally:
        code = stop_dashboard(server)
    assert code == 0
