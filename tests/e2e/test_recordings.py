"""A recording on the page: play, pause, seek, step, speed; what is listed says what it is; nothing lingers."""

import re
from collections.abc import Iterator

import httpx
import pytest
from playwright.sync_api import Browser, Page, expect

from tests.e2e.audit import COLLISIONS
from tests.e2e.conftest import PATIENCE_MS, VIEWPORT
from tests.server.running import START_S, TOKEN, Running, start, wait_for
from tests.small_recordings import write_robot

pytestmark = pytest.mark.browser
SECONDS = 8.0


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    folder = tmp_path_factory.mktemp("recordings")
    write_robot(folder / "recordings" / "stationary robot", SECONDS)
    running = start(folder, recordings=str(folder / "recordings"))
    yield running
    assert running.stop() == 0


@pytest.fixture(scope="module")
def page(browser: Browser, server: Running) -> Iterator[Page]:
    """Signed in, without the 3D view, which takes a core to draw in software."""
    login = re.search(r"Open (\S+)", server.out[-1])
    assert login is not None
    context = browser.new_context(viewport=VIEWPORT, reduced_motion="reduce")
    context.route("**/viewer/**", lambda route: route.abort())
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
        page.get_by_role("button", name="Play stationary robot").click()
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
    expect(playing.locator("#camera .camera-badge")).to_have_text("Paused")


def test_speed(playing: Page, client: httpx.Client) -> None:
    playing.locator("#player-speed").select_option("4")
    wait_for(lambda: client.get("/api/v1/playback").json()["speed"] == 4.0)


SCREENS = {
    "large": (1920, 1080, 32),
    "laptop": (1366, 768, 32),
    "phone": (390, 844, 44),
    "small phone": (320, 640, 44),
    "phone on its side": (844, 390, 44),
    "laptop at 200 %": (683, 384, 32),
}


@pytest.mark.usefixtures("playing")
@pytest.mark.parametrize("screen", SCREENS)
def test_the_player_covers_nothing_and_is_large_enough(browser: Browser, server: Running, screen: str) -> None:
    width, height, least_px = SCREENS[screen]
    context = browser.new_context(viewport={"width": width, "height": height}, has_touch=least_px == 44)
    context.route("**/viewer/**", lambda route: route.abort())
    context.request.post(f"{server.url}/api/v1/session", data={"token": TOKEN})
    page = context.new_page()
    page.goto(server.url)
    expect(page.locator("#player-play")).to_be_enabled()
    for part in ("#player", "#player-play", "#player-position", "#player-speed", "#camera-image"):
        expect(page.locator(part)).to_be_in_viewport(ratio=0.99)
    # A page that opens while nothing plays has the image too.
    expect(page.locator("#camera .camera-empty")).to_be_hidden()
    assert page.evaluate(COLLISIONS) == []
    assert page.locator("#drive").evaluate("drive => drive.scrollWidth <= drive.clientWidth"), "the drive panel is cut"
    sizes = [button.bounding_box() for button in page.locator("#player button, #player select").all()]
    assert all(box is not None and min(box["width"], box["height"]) >= least_px for box in sizes), sizes
    slider = page.locator("#player-position").bounding_box()
    assert slider is not None
    assert slider["width"] >= 180
    context.close()


def test_nothing_of_the_recording_lingers_when_the_robot_comes_back(playing: Page, client: httpx.Client) -> None:
    expect(playing.locator("#camera .camera-empty")).to_be_hidden()
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
