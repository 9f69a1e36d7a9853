"""A recording on the page: play, pause, seek, step, speed; what is listed says what it is; nothing lingers."""

import re
from collections.abc import Iterator

import httpx
import pytest
from playwright.sync_api import Browser, Page, expect

from tests.e2e.conftest import PATIENCE_MS, VIEWPORT
from tests.server.running import START_S, Running, start, wait_for
from tests.small_recordings import write_robot

pytestmark = pytest.mark.browser
SECONDS = 8.0


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    folder = tmp_path_factory.mktemp("recordings")
    write_robot(folder / "recordings" / "robot at rest", SECONDS)
    running = start(folder, recordings=str(folder / "recordings"))
    yield running
    assert running.stop() == 0


@pytest.fixture(scope="module")
def page(browser: Browser, server: Running) -> Iterator[Page]:
    login = re.search(r"Open (\S+)", server.out[-1])
    assert login is not None
    context = browser.new_context(viewport=VIEWPORT, reduced_motion="reduce")
    page = context.new_page()
    page.set_default_timeout(PATIENCE_MS)
    page.goto(login.group(1))
    yield page
    context.close()


@pytest.fixture
def client(server: Running) -> Iterator[httpx.Client]:
    with server.client() as client:
        yield client


def position_s(client: httpx.Client) -> float:
    return client.get("/api/v1/playback").raise_for_status().json()["position_s"]


def paused(client: httpx.Client) -> bool:
    return client.get("/api/v1/playback").json()["paused"]


@pytest.fixture
def playing(page: Page, client: httpx.Client) -> Page:
    """The recording is open and paused."""
    if client.get("/api/v1/state").json()["source"]["kind"] != "recording":
        expect(page.locator("#player")).to_be_hidden()
        page.locator("#source").click()
        page.get_by_role("button", name="Play robot at rest").click()
        expect(page.locator("#player")).to_be_visible()
    if not paused(client):
        page.locator("#player-play").click()
        wait_for(lambda: paused(client))
    return page


def test_pause_and_play(playing: Page, client: httpx.Client) -> None:
    before = position_s(client)
    expect(playing.locator("#player-play")).to_have_accessible_name("Play")
    playing.locator("#player-play").click()
    wait_for(lambda: position_s(client) > before)
    expect(playing.locator("#player-play")).to_have_accessible_name("Pause")


def test_seek_and_step(playing: Page, client: httpx.Client) -> None:
    playing.locator("#player-position").fill("3")
    wait_for(lambda: position_s(client) == 3.0)
    expect(playing.locator(".player-time")).to_contain_text("0:03.0 / 0:07.9")
    playing.get_by_role("button", name="One frame back").click()
    wait_for(lambda: position_s(client) == 2.95)
    playing.get_by_role("button", name="One frame ahead").click()
    wait_for(lambda: position_s(client) == 3.0)
    expect(playing.locator("#camera .picture-badge")).to_have_text("Paused")


def test_speed(playing: Page, client: httpx.Client) -> None:
    playing.locator("#player-speed").select_option("4")
    wait_for(lambda: client.get("/api/v1/playback").json()["speed"] == 4.0)


def test_nothing_of_the_recording_lingers_when_the_robot_comes_back(playing: Page, client: httpx.Client) -> None:
    expect(playing.locator("#camera .picture-empty")).to_be_hidden()
    playing.locator("#source").click()
    playing.locator("#sim-start").click()
    wait_for(lambda: client.get("/api/v1/state").json()["source"]["kind"] == "sim", START_S)
    expect(playing.locator("#player")).to_be_hidden()
    wait_for(lambda: client.get("/api/v1/state").json()["session"] == "running", START_S)


def test_a_run_says_what_it_was_and_is_there_after_a_reload(page: Page, client: httpx.Client) -> None:
    run = {"config": "sim", "overrides": {"gait.name": "pedal", "sim.world": "office"}, "seed": 7, "duration_s": 0.5}
    client.post("/api/v1/runs", json=run).raise_for_status()
    page.reload()
    page.locator("#tab-runs").click()
    row = page.locator("#run-rows tr").first
    for word in ("pedal", "office", "seed 7", "sim"):
        expect(row).to_contain_text(word)
