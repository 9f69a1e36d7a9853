"""What ends a drive, and what the stop keys do: a robot never drives on an event that did not come."""

import re
from collections.abc import Callable, Iterator

import httpx
import pytest
from playwright.sync_api import Browser, Page, expect

from tests.e2e.watching import poll
from tests.server.running import START_S, TOKEN, Running, start, wait_for

pytestmark = [pytest.mark.browser, pytest.mark.alone]
# Keys that go down and never come up, as the browser reports them.
KEYDOWN = """([code, options]) => document.body.dispatchEvent(new KeyboardEvent('keydown',
    {code, key: code.replace(/Key|Left$/g, '').toLowerCase(), bubbles: true, cancelable: true, ...options}))"""
KEYUP = "(code) => document.body.dispatchEvent(new KeyboardEvent('keyup', {code, bubbles: true}))"
META = {"key": "Meta", "metaKey": True}
BUSY = "(ms) => { const until = performance.now() + ms; while (performance.now() < until); }"


@pytest.fixture(scope="module")
def still(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    running = start(tmp_path_factory.mktemp("letting-go"))
    with running.client() as client:
        wait_for(lambda: client.get("/api/v1/state").json()["session"] == "running", START_S)
    yield running
    running.stop()


@pytest.fixture(scope="module")
def page(browser: Browser, still: Running) -> Iterator[Page]:
    """In control, without the 3D view, which takes a core to draw in software."""
    context = browser.new_context(viewport={"width": 1280, "height": 800}, reduced_motion="reduce")
    context.route("**/viewer/**", lambda route: route.abort())
    context.request.post(f"{still.url}/api/v1/session", data={"token": TOKEN})
    page = context.new_page()
    page.goto(still.url)
    page.locator("#control-take").click()
    expect(page.locator("#control-state")).to_have_text("You")
    yield page
    context.close()


@pytest.fixture
def client(still: Running) -> Iterator[httpx.Client]:
    with still.client() as client:
        yield client


def state(client: httpx.Client) -> dict:
    return client.get("/api/v1/state").json()


def drive_with_w(page: Page, client: httpx.Client, repeats: int = 0) -> None:
    """W goes down, repeats as often as said, and stays down; the robot moves."""
    # From the page's body, where nothing is pressed or typed.
    page.evaluate("document.activeElement.blur()")

    def driven() -> float:
        # A machine that is too busy for the page releases by itself: then it is pressed anew.
        if page.locator('[data-drive="forward"]').get_attribute("aria-pressed") != "true":
            page.evaluate(KEYUP, "KeyW")
            page.evaluate(KEYDOWN, ["KeyW", {}])
        return state(client)["gait"]["drive"]

    poll(driven, lambda drive: drive == 1.0, "the robot driven by W")
    for _ in range(repeats):
        page.wait_for_timeout(60)
        page.evaluate(KEYDOWN, ["KeyW", {"repeat": True}])


def expect_released(page: Page, client: httpx.Client, why: str) -> None:
    poll(lambda: state(client)["moving"], lambda on: not on, "the stationary robot")
    expect(page.locator('[data-drive="forward"]')).to_have_attribute("aria-pressed", "false")
    expect(page.locator("#notice")).to_contain_text(why)


LOST_KEY_UPS: dict[str, tuple[Callable[[Page], object], str]] = {
    "Command goes down": (lambda page: page.evaluate(KEYDOWN, ["MetaLeft", META]), "Command"),
    "a key with Command": (lambda page: page.evaluate(KEYDOWN, ["KeyC", {"metaKey": True}]), "Command"),
    "Alt goes down": (lambda page: page.keyboard.press("Alt"), "Alt"),
    "a menu opens": (lambda page: page.locator(".brand").dispatch_event("contextmenu", {"bubbles": True}), "menu"),
    "an input method composes": (lambda page: page.locator("body").dispatch_event("compositionstart"), "keyboard"),
    "a field has the focus": (lambda page: page.locator("#preset").focus(), "field"),
}


@pytest.mark.parametrize("lost", LOST_KEY_UPS)
def test_a_key_whose_key_up_may_never_come_is_released(page: Page, client: httpx.Client, lost: str) -> None:
    act, why = LOST_KEY_UPS[lost]
    drive_with_w(page, client)
    act(page)
    expect_released(page, client, why)


def test_a_key_pressed_with_command_does_not_drive(page: Page, client: httpx.Client) -> None:
    page.evaluate("document.activeElement.blur()")
    page.evaluate(KEYDOWN, ["KeyW", {"metaKey": True}])
    expect(page.locator('[data-drive="forward"]')).to_have_attribute("aria-pressed", "false")
    assert not state(client)["moving"]


def test_a_key_whose_repeats_stop_is_released(page: Page, client: httpx.Client) -> None:
    drive_with_w(page, client, repeats=4)
    expect_released(page, client, "repeats have stopped")


def test_a_key_that_another_keeps_from_repeating_drives_on(page: Page, client: httpx.Client) -> None:
    """Only the key pressed last repeats, and after its key-up none does."""
    drive_with_w(page, client, repeats=4)
    page.keyboard.press("KeyA")
    page.wait_for_timeout(1200)
    assert state(client)["gait"]["drive"] == 1.0
    page.evaluate(KEYUP, "KeyW")
    poll(lambda: state(client)["moving"], lambda on: not on, "the stationary robot")


def test_a_gamepad_that_vanishes_without_an_event_is_released(page: Page, client: httpx.Client) -> None:
    page.evaluate(
        """() => {
            window.pad = {connected: true, index: 0, id: 'a pad', axes: [0, 0], buttons: []};
            navigator.getGamepads = () => [window.pad];
        }"""
    )
    page.wait_for_timeout(300)
    page.evaluate("window.pad.axes = [0, -1]")
    poll(lambda: state(client)["gait"]["drive"], lambda drive: drive == 1.0, "the robot driven by the stick")
    page.evaluate("window.pad = null")
    expect_released(page, client, "gamepad has gone")
    page.evaluate("delete navigator.getGamepads")


def test_a_second_mouse_button_does_not_hide_the_release(page: Page, client: httpx.Client) -> None:
    box = page.locator('[data-drive="forward"]').bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + 10, box["y"] + 10)
    page.mouse.down()
    poll(lambda: state(client)["gait"]["drive"], lambda drive: drive == 1.0, "the robot driven by the pad")
    page.mouse.down(button="middle")
    page.mouse.up()
    poll(lambda: state(client)["moving"], lambda on: not on, "the stationary robot")
    page.mouse.up(button="middle")


def test_a_hold_under_load_is_reported_once_and_nothing_starts_by_itself(page: Page, client: httpx.Client) -> None:
    """W stays down while the page freezes again and again, each time longer than the robot waits."""
    drive_with_w(page, client)
    expect(page.locator("#event-list li").first).to_contain_text("Start serpentine")
    before = events(page)
    for _ in range(4):
        page.evaluate(BUSY, 900)
        page.wait_for_timeout(400)
    expect_released(page, client, "Release it, then press again")
    new = events(page)[: len(events(page)) - len(before)]
    assert [text for text in new if re.search(r"\bstart\b serpentine", text, re.IGNORECASE)] == []
    assert sum("eld" in text for text in new) <= 1, new
    drive_with_w(page, client)
    page.evaluate(KEYUP, "KeyW")
    poll(lambda: state(client)["moving"], lambda on: not on, "the stationary robot")


def events(page: Page) -> list[str]:
    return page.locator("#event-list li span:nth-child(2)").all_inner_texts()


def test_the_stop_keys_do_their_usual_work_in_dialogs_and_fields(page: Page, client: httpx.Client) -> None:
    page.locator("#start").click()
    poll(lambda: state(client)["moving"], bool, "the robot moving")
    for opener, dialog in (("#source", "#source-dialog"), ('button[aria-label^="Keys"]', "#help")):
        page.locator(opener).click()
        expect(page.locator(dialog)).to_be_visible()
        page.keyboard.press("Escape")
        expect(page.locator(dialog)).to_be_hidden()
    page.locator("#source").click()
    page.locator("#source-dialog").get_by_role("button", name="Close").focus()
    page.keyboard.press("Space")
    expect(page.locator("#source-dialog")).to_be_hidden()
    for field in ("#parameter-period_s", "#preset"):
        # A page that has lost its link or control for a moment has its fields switched off: Space would stop the robot.
        expect(page.locator(field)).to_be_enabled()
        page.locator(field).focus()
        page.keyboard.press("Space")
        page.keyboard.press("Escape")
        page.locator(field).focus()
        page.keyboard.press("Escape")
        expect(page.locator(field)).not_to_be_focused()
    latch = state(client)["estop"]
    assert not latch["latched"], latch
    assert state(client)["moving"]


@pytest.mark.parametrize("key", ["Space", "Escape"])
def test_the_stop_keys_stop_from_the_page(page: Page, client: httpx.Client, key: str) -> None:
    page.evaluate("document.activeElement.blur()")
    page.keyboard.press(key)
    poll(lambda: state(client)["estop"]["latched"], bool, "the latch")
    page.locator("#estop-reset").click()
    expect(page.locator("#estop-banner")).to_be_hidden()
