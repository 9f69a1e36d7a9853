"""Operating the robot from the page: control, driving, E-stop, gaits, a phone, a restarted server."""

import os
import re
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
from playwright.sync_api import Browser, Page, expect

from tests.e2e.watching import poll
from tests.server.running import START_S, TOKEN, Running, start, wait_for

pytestmark = [pytest.mark.browser, pytest.mark.alone]
DESKTOP, PHONE = {"width": 1280, "height": 800}, {"width": 390, "height": 844}
PICTURES = os.environ.get("SNAKESLAM_SCREENSHOTS")
# The pad's button is held by a pointer that presses and stays.
HOLD = "element => element.dispatchEvent(new PointerEvent('pointerdown', {pointerId: 1, button: 0, bubbles: true}))"


@pytest.fixture(scope="module")
def still(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    running = start(tmp_path_factory.mktemp("operator"))
    wait_running(running)
    yield running
    running.stop()


def wait_running(running: Running) -> None:
    with running.client() as client:
        wait_for(lambda: client.get("/api/v1/state").json()["session"] == "running", START_S)


def open_page(browser: Browser, server: Running, size: dict[str, int] = DESKTOP) -> Page:
    """A page in a browser of its own, signed in; without the 3D view, which takes a core to draw in software."""
    context = browser.new_context(viewport=size, reduced_motion="reduce", has_touch=size == PHONE)  # type: ignore[arg-type]
    context.route("**/viewer/**", lambda route: route.abort())
    context.request.post(f"{server.url}/api/v1/session", data={"token": TOKEN})
    page = context.new_page()
    page.goto(server.url)
    expect(page.locator("#link-state")).to_contain_text("Live")
    return page


@pytest.fixture(scope="module")
def page(browser: Browser, still: Running) -> Iterator[Page]:
    page = open_page(browser, still)
    yield page
    page.context.close()


@pytest.fixture
def client(still: Running) -> Iterator[httpx.Client]:
    with still.client() as client:
        yield client


def screenshot(page: Page, name: str) -> None:
    """Keep a screenshot of the page where SNAKESLAM_SCREENSHOTS says."""
    if PICTURES is not None:
        page.screenshot(path=Path(PICTURES) / f"{name}.png")


def gait(client: httpx.Client) -> dict:
    return client.get("/api/v1/state").json()["gait"]


def moving(client: httpx.Client) -> bool:
    return client.get("/api/v1/state").json()["moving"]


def take_control(page: Page) -> None:
    if not page.locator("#control-release").is_visible():
        page.locator("#control-take").click()
    expect(page.locator("#control-state")).to_have_text("You")


def test_keys_drive_while_held_and_release(page: Page, client: httpx.Client) -> None:
    take_control(page)
    page.locator("body").click(position={"x": 5, "y": 70})
    page.keyboard.down("KeyS")
    poll(lambda: gait(client)["drive"], lambda drive: drive == -1.0, "the robot backing")
    expect(page.locator("#pad-words")).to_contain_text("Back at 100 %")
    expect(page.locator("#command-age")).to_have_text(re.compile(r"\d+ ms"))
    page.keyboard.down("KeyA")
    poll(lambda: gait(client)["turn"], lambda turn: turn == 1.0, "the robot turning left")
    screenshot(page, "driving")
    page.keyboard.up("KeyA")
    page.keyboard.up("KeyS")
    poll(lambda: moving(client), lambda on: not on, "the stationary robot")
    assert (gait(client)["drive"], gait(client)["turn"]) == (0.0, 0.0)


@pytest.mark.parametrize("lost", ["blur", "hidden", "key-up elsewhere"])
def test_a_hold_ends_with_what_held_it(page: Page, client: httpx.Client, lost: str) -> None:
    take_control(page)
    pad = page.locator('[data-drive="forward"]')
    page.locator("#drive-speed").fill("0.5")
    if lost == "key-up elsewhere":
        pad.focus()
        page.keyboard.down("ArrowUp")
    else:
        pad.evaluate("element => element.setPointerCapture = () => undefined")
        pad.evaluate(HOLD)
    poll(lambda: gait(client)["drive"], lambda drive: drive == 0.5, "the robot at half its pace")
    if lost == "blur":
        page.evaluate("window.dispatchEvent(new Event('blur'))")
    elif lost == "hidden":
        page.evaluate("Object.defineProperty(document, 'hidden', {value: true, configurable: true})")
        page.evaluate("document.dispatchEvent(new Event('visibilitychange'))")
        page.evaluate("delete document.hidden")
    else:
        page.locator("#turn").evaluate("element => element.focus()")
        page.keyboard.up("ArrowUp")
    poll(lambda: moving(client), lambda on: not on, "the stationary robot")
    expect(pad).to_have_attribute("aria-pressed", "false")
    page.locator("#drive-speed").fill("1")


def test_a_second_page_watches_until_it_has_taken_control(
    browser: Browser, page: Page, still: Running, client: httpx.Client
) -> None:
    take_control(page)
    second = open_page(browser, still)
    expect(second.locator("#control-holder")).to_contain_text("has control")
    expect(second.locator("#start")).to_be_disabled()
    expect(second.locator('[data-drive="forward"]')).to_be_disabled()
    expect(second.locator("#estop")).to_be_enabled()
    page.locator("#start").click()
    expect(second.locator("#session-state")).to_have_text("Moving")
    screenshot(second, "watching")
    second.locator("#control-take").click()
    expect(second.locator("#control-state")).to_have_text("You")
    expect(page.locator("#control-holder")).to_contain_text("has control")
    expect(page.locator("#start")).to_be_disabled()
    expect(second.locator("#event-list")).to_contain_text("control taken over from")
    second.locator('[data-gait="pedal"]').click()
    poll(lambda: gait(client)["name"], lambda name: name == "pedal", "another gait from the second page")
    second.context.close()
    # The page that goes gives control back, and the robot stops.
    poll(lambda: moving(client), lambda on: not on, "the stationary robot")
    poll(lambda: client.get("/api/v1/state").json()["control"]["id"], lambda held: held is None, "control free")


def test_the_estop_latches_and_reset_does_not_move(page: Page, client: httpx.Client) -> None:
    take_control(page)
    page.locator("#start").click()
    poll(lambda: moving(client), bool, "the robot moving")
    page.locator("#estop").click()
    expect(page.locator("#estop-banner")).to_contain_text("latched")
    expect(page.locator('[data-drive="forward"]')).to_be_disabled()
    poll(lambda: moving(client), lambda on: not on, "the stationary robot")
    screenshot(page, "stopped")
    page.locator("#estop-reset").click()
    expect(page.locator("#estop-banner")).to_be_hidden()
    assert not moving(client)


def test_a_preset_is_chosen_applied_and_saved(page: Page, client: httpx.Client) -> None:
    take_control(page)
    page.locator('[data-gait="serpentine"]').click()
    expect(page.locator('[data-gait="serpentine"]')).to_have_attribute("aria-pressed", "true")
    page.locator("#preset").select_option("Calm")
    page.locator("#gait-apply").click()
    poll(lambda: gait(client)["period_s"], lambda period: period == 8.0, "the calm period")
    page.locator(".presets summary").click()
    page.locator("#preset-name").fill("mine")
    page.locator("#preset-save").click()
    expect(page.locator("#preset")).to_have_value("mine")
    page.locator("#preset-forget").click()
    expect(page.locator("#preset option", has_text="mine")).to_have_count(0)
    page.locator(".presets summary").click()


def test_a_phone_has_view_pad_camera_and_stop_in_reach(browser: Browser, still: Running, client: httpx.Client) -> None:
    phone = open_page(browser, still, PHONE)
    for control in ("#viewer", "#control-take", '[data-drive="forward"]', "#start", "#stop", "#estop"):
        expect(phone.locator(control)).to_be_in_viewport()
    assert phone.evaluate("document.documentElement.scrollWidth <= innerWidth"), "the page is wider than the screen"
    box = phone.locator('[data-drive="forward"]').bounding_box()
    assert box is not None
    assert min(box["width"], box["height"]) >= 44
    screenshot(phone, "phone")
    phone.context.close()


def test_small_text_has_contrast_in_both_themes(page: Page) -> None:
    for scheme in ("dark", "light"):
        page.evaluate(f"document.documentElement.dataset.theme = '{scheme}'")
        poor = page.evaluate(CONTRAST)
        screenshot(page, scheme)
        assert poor == [], (scheme, poor)


# Text of what can be used now against the first opaque background behind it (WCAG 1.4.3: 4.5, 3 for large text).
CONTRAST = """() => {
    const canvas = document.createElement('canvas').getContext('2d', {willReadFrequently: true});
    const rgba = colour => {
        canvas.clearRect(0, 0, 1, 1);
        canvas.fillStyle = colour;
        canvas.fillRect(0, 0, 1, 1);
        return [...canvas.getImageData(0, 0, 1, 1).data];
    };
    const channel = v => (v /= 255) <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4;
    const light = ([r, g, b]) => 0.2126 * channel(r) + 0.7152 * channel(g) + 0.0722 * channel(b);
    const behind = element => {
        for (let e = element; e; e = e.parentElement) {
            const found = rgba(getComputedStyle(e).backgroundColor);
            if (found[3] > 250) return found;
        }
        return [255, 255, 255, 255];
    };
    const poor = [];
    for (const element of document.querySelectorAll('body *')) {
        const words = [...element.childNodes].some(n => n.nodeType === 3 && n.textContent.trim());
        if (!words || !element.checkVisibility()) continue;
        if (element.closest(':disabled, [aria-disabled=true], dialog')) continue;
        if (element.classList.contains('visually-hidden')) continue;
        if (element.closest('.link-down, .camera-stage, .view')) continue;
        const style = getComputedStyle(element);
        const [a, b] = [light(rgba(style.color)), light(behind(element))].sort((x, y) => y - x);
        const size = parseFloat(style.fontSize), large = size >= 24 || (size >= 18.66 && style.fontWeight >= 700);
        const ratio = (a + 0.05) / (b + 0.05);
        const name = element.id || element.className;
        if (ratio < (large ? 3 : 4.5)) poor.push([name, element.textContent.slice(0, 20), ratio.toFixed(2)]);
    }
    return poor;
}"""


def test_everything_can_be_reached_and_is_named(page: Page) -> None:
    unnamed = page.evaluate("""() => [...document.querySelectorAll('button, input, select, iframe, [role=tab]')]
        .filter(e => e.checkVisibility() && !(e.ariaLabel || e.title || e.textContent.trim() || e.labels?.length))
        .map(e => e.id || e.className)""")
    assert unnamed == []
    take_control(page)
    missing = {"estop", "control-release", "forward", "left", "start", "turn", "drive-speed", "preset"}
    page.locator("#source").focus()
    for _ in range(60):
        page.keyboard.press("Tab")
        missing.discard(page.evaluate("document.activeElement.id || document.activeElement.dataset.drive || ''"))
        if not missing:
            return
    assert missing == set()


def test_the_page_comes_back_when_the_server_does(page: Page, still: Running) -> None:
    """The last test: its server is another one in the same state folder, and so with the same sessions."""
    take_control(page)
    port = int(still.url.rsplit(":", 1)[1])
    still.stop()
    expect(page.locator("#link-banner")).to_contain_text("lost")
    again = start(still.folder, port=port)
    try:
        wait_running(again)
        expect(page.locator("#link-state")).to_contain_text("Live", timeout=30_000)
        expect(page.locator("#signin")).to_be_hidden()
        expect(page.locator("#control-holder")).to_contain_text("Nobody")
        take_control(page)
        page.locator("#start").click()
        expect(page.locator("#session-state")).to_have_text("Moving")
    finally:
        again.stop()
