"""The page on every screen, for everybody: axe finds nothing, what drives is seen, nothing moves or is too small."""

import signal
from collections.abc import Iterator

import httpx
import numpy as np
import pytest
from playwright.sync_api import Browser, BrowserContext, Page, expect

from tests.e2e.audit import COLLISIONS, Audit
from tests.e2e.watching import poll
from tests.server.running import START_S, TOKEN, VIEWER_TOKEN, Running, start, wait_for
from tests.small_recordings import write_tum

pytestmark = pytest.mark.browser
DESKTOP, PHONE = {"width": 1366, "height": 768}, {"width": 390, "height": 844}
LYING = {"width": 844, "height": 390}
ZOOMED = {"width": 683, "height": 384}
# What can be pressed and is seen, with a smaller side than it should have.
SMALL = """(least) => [...document.querySelectorAll('button, a[href], select, input, summary, [role=tab]')]
    .filter((e) => e.checkVisibility({visibilityProperty: true}))
    .map((e) => [e, e.getBoundingClientRect()])
    .filter(([, {width, height}]) => width > 0 && Math.min(width, height) < least - 0.5)
    .map(([e, {width, height}]) => `${e.id || e.className || e.textContent}: ${width | 0} x ${height | 0}`)"""


@pytest.fixture(scope="module")
def still(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    recordings = tmp_path_factory.mktemp("recordings")
    write_tum(recordings / "small")
    running = start(tmp_path_factory.mktemp("accessible"), recordings=str(recordings))
    with running.client() as client:
        wait_for(lambda: client.get("/api/v1/state").json()["session"] == "running", START_S)
    yield running
    running.stop()


def new_context(browser: Browser, size: dict[str, int]) -> BrowserContext:
    touch = size in (PHONE, LYING)
    context = browser.new_context(viewport=size, reduced_motion="reduce", has_touch=touch)  # type: ignore[arg-type]
    context.route("**/viewer/**", lambda route: route.abort())
    return context


def sign_in(context: BrowserContext, server: Running, token: str = TOKEN) -> Page:
    """A page of its own, without the 3D view, which takes a core to draw in software."""
    context.request.post(f"{server.url}/api/v1/session", data={"token": token})
    page = context.new_page()
    page.goto(server.url)
    expect(page.locator("#link-state")).to_contain_text("Live")
    return page


def free(server: Running) -> None:
    """Nobody has control, nothing is latched."""
    with server.client() as client:
        key = client.post("/api/v1/control/lease", json={"name": "a test", "take_over": True}).json()["key"]
        headers = {"Control-Lease": key}
        client.post("/api/v1/estop/reset", headers=headers).raise_for_status()
        client.delete("/api/v1/control/lease", headers=headers).raise_for_status()


@pytest.mark.parametrize("size", [DESKTOP, PHONE], ids=["desktop", "phone"])
def test_axe_finds_nothing_in_any_state(browser: Browser, still: Running, size: dict[str, int]) -> None:
    free(still)
    audit = Audit("light", "dark") if size == DESKTOP else Audit("light")
    stranger = new_context(browser, size)
    page = stranger.new_page()
    page.goto(still.url)
    expect(page.locator("#signin")).to_be_visible()
    audit.check(page, "signed out")
    stranger.close()
    watcher = new_context(browser, size)
    audit.check(sign_in(watcher, still, VIEWER_TOKEN), "watching")
    watcher.close()
    context = new_context(browser, size)
    see_as_operator(sign_in(context, still), still, audit)
    context.close()
    assert audit.states == 11
    assert audit.found == [], "\n".join(audit.found)


def see_as_operator(page: Page, server: Running, audit: Audit) -> None:
    page.locator("#control-take").click()
    expect(page.locator("#control-state")).to_have_text("You")
    expect(page.locator(".gait-card").first).to_be_enabled()
    expect(page.locator("#patrol")).to_be_visible()
    audit.check(page, "in control, the patrol's card")
    page.locator("#view-layers").click()
    expect(page.locator("#layer-map")).to_be_visible()
    audit.check(page, "layers of the view")
    page.locator("#view-layers").click()
    page.locator("#estop").click()
    expect(page.locator("#estop-reset")).to_be_visible()
    assert page.locator("#estop").get_attribute("aria-label") == "STOPPED, emergency stop is latched"
    audit.check(page, "E-stop latched")
    page.locator("#estop-reset").click()
    expect(page.locator("#estop-banner")).to_be_hidden()
    expect(page.locator("#status-line")).to_contain_text("The robot is held")
    audit.check(page, "held")
    for opener, dialog in (("#source", "#source-dialog"), ("#tools button", "#help")):
        page.locator(opener).first.click()
        expect(page.locator(dialog)).to_be_visible()
        audit.check(page, f"dialog {dialog}")
        page.keyboard.press("Escape")
    page.locator("#tab-runs").click()
    expect(page.locator("#runs")).to_be_visible()
    audit.check(page, "runs")
    take_over(server)
    expect(page.locator("#taken-banner")).to_be_visible()
    audit.check(page, "taken over")
    page.locator("#taken-back").click()
    expect(page.locator("#taken-banner")).to_be_hidden()
    page.locator("#source").click()
    page.locator('[data-recording="small"]').get_by_role("button").click()
    expect(page.locator("#player")).to_be_visible()
    audit.check(page, "a recording")
    page.locator("#source").click()
    page.locator("#sim-start").click()
    expect(page.locator("#source")).to_contain_text("Simulator")
    with server.client() as client:
        wait_for(lambda: client.get("/api/v1/state").json()["session"] == "running", START_S)


def take_over(server: Running) -> httpx.Response:
    with server.client() as client:
        return client.post("/api/v1/control/lease", json={"name": "Somebody else", "take_over": True, "seconds": 3000})


def operate(context: BrowserContext, server: Running) -> Page:
    """A page in control."""
    free(server)
    page = sign_in(context, server)
    page.locator("#control-take").click()
    expect(page.locator("#control-state")).to_have_text("You")
    return page


DRIVES = [f'[data-drive="{direction}"]' for direction in ("forward", "left", "back", "right")]
DRIVES += ["#start", "#stop", "#estop"]
LOOKS = ["#viewer", "#camera-image", "#control-release"]
HEAD = ["#verdict", "#head-yaw", "#head-controller", "#head-neck", "#head-left"]
SEEN = {"desktop": (DESKTOP, HEAD), "phone": (PHONE, []), "phone on its side": (LYING, []), "200 % zoom": (ZOOMED, [])}


@pytest.mark.parametrize("screen", SEEN)
def test_what_drives_the_robot_is_seen_without_scrolling(browser: Browser, still: Running, screen: str) -> None:
    size, more = SEEN[screen]
    context = new_context(browser, size)
    page = operate(context, still)
    for control in (*LOOKS, *DRIVES, *more):
        expect(page.locator(control)).to_be_in_viewport(ratio=0.99)
    assert page.evaluate(COVERED, DRIVES) == []
    expect(page.locator("#patrol")).to_be_visible()
    assert page.evaluate(COLLISIONS) == []
    view = page.locator("#viewer").bounding_box()
    camera, pad = page.locator("#camera-image").bounding_box(), page.locator("#pad").bounding_box()
    assert view is not None and camera is not None and pad is not None  # noqa: PT018
    assert view["height"] >= 180
    assert camera["height"] >= 110
    # The operator's hand does not cover what they look at.
    beside = pad["x"] >= camera["x"] + camera["width"] or pad["x"] + pad["width"] <= camera["x"]
    assert beside or pad["y"] >= camera["y"] + camera["height"]
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth"), "the page is wider than the screen"
    least = 44 if size in (PHONE, LYING) else 32
    assert page.evaluate(SMALL, least) == []
    page.locator("#tab-runs").click()
    assert page.evaluate(SMALL, least) == []
    context.close()


COVERED = """(selectors) => selectors.filter((selector) => {
    const element = document.querySelector(selector);
    const {left, top, width, height} = element.getBoundingClientRect();
    return !element.contains(document.elementFromPoint(left + width / 2, top + height / 2));
})"""
# Where everything is that can be pressed, but for the banners' own buttons and what lies on the 3D view below them.
POSITIONS = """() => Object.fromEntries([...document.querySelectorAll('button, select, input, summary')]
    .filter((e) => e.checkVisibility() && !e.closest('.banners, .view, dialog'))
    .map((e, index) => [`${index} ${e.id || e.className}`, e.getBoundingClientRect()])
    .map(([name, {x, y}]) => [name, [Math.round(x), Math.round(y)]]))"""


def settled(page: Page) -> dict[str, list[int]]:
    """The positions of all controls once the page's first texts have come and move them no more."""
    seen: list[dict[str, list[int]]] = [{}]

    def unchanged() -> bool:
        page.wait_for_timeout(1000)
        seen.append(page.evaluate(POSITIONS))
        return seen[-1] == seen[-2]

    poll(unchanged, bool, "a settled page")
    return seen[-1]


@pytest.mark.parametrize("size", [DESKTOP, PHONE, LYING], ids=["desktop", "phone", "lying"])
def test_no_banner_moves_a_control(browser: Browser, still: Running, size: dict[str, int]) -> None:
    context = new_context(browser, size)
    page = operate(context, still)
    before = settled(page)
    with still.client() as client:
        client.post("/api/v1/estop", json={"reason": "pressed elsewhere"}).raise_for_status()
    expect(page.locator("#estop-banner")).to_be_visible()
    assert page.evaluate(POSITIONS) == before
    page.locator("#estop-reset").click()
    expect(page.locator("#estop-banner")).to_be_hidden()
    page.route("**/gait/start", lambda route: route.abort())
    page.locator("#start").click()
    expect(page.locator("#notice")).to_be_visible()
    assert page.evaluate(POSITIONS) == before
    take_over(still)
    expect(page.locator("#taken-banner")).to_be_visible()
    positions = page.evaluate(POSITIONS)
    assert {
        name: position for name, position in before.items() if name in positions and positions[name] != position
    } == {}
    context.close()


def test_an_operator_has_a_name_of_their_own_and_sees_who_took_over(browser: Browser, still: Running) -> None:
    free(still)
    context = new_context(browser, DESKTOP)
    page = sign_in(context, still)
    page.locator("#operator-name-change").click()
    page.locator("#operator-name").fill("  Anna \u0007 K\u00fchn ")
    page.keyboard.press("Enter")
    page.reload()
    expect(page.locator("#operator-name-now")).to_contain_text("Anna K\u00fchn")
    page.locator("#control-take").click()
    expect(page.locator("#control-state")).to_have_text("You")
    with still.client() as client:
        assert client.get("/api/v1/state").json()["control"]["holder"] == "Anna K\u00fchn"
    take_over(still)
    banner = page.locator("#taken-banner")
    expect(banner).to_contain_text("Somebody else took over control")
    assert banner.evaluate("e => parseFloat(getComputedStyle(e).fontSize)") >= 14
    page.locator("#taken-back").click()
    expect(page.locator("#control-state")).to_have_text("You")
    expect(banner).to_be_hidden()
    context.close()


# The widest stretch of columns without a coloured pixel, between the first and the last that have one.
WIDEST_GAP = """canvas => {
    const {width, height} = canvas;
    const data = canvas.getContext('2d').getImageData(0, 0, width, height).data;
    const drawn = Array.from({length: width}, (_, x) => {
        for (let y = 0; y < height; y++) {
            const [r, g, b, a] = data.subarray(4 * (y * width + x));
            if (a > 100 && Math.max(r, g, b) - Math.min(r, g, b) > 60) return true;
        }
        return false;
    });
    let widest = 0, current = 0;
    for (let x = drawn.indexOf(true); x <= drawn.lastIndexOf(true); x++) {
        current = drawn[x] ? 0 : current + 1;
        widest = Math.max(widest, current);
    }
    return widest / width;
}"""


def test_a_gap_in_the_data_is_a_gap_in_the_joint_curves(browser: Browser, still: Running) -> None:
    """A server that is frozen for 8 s of the 20 s shown; its sockets keep a part of what it missed."""
    context = new_context(browser, DESKTOP)
    page = sign_in(context, still)
    curves = page.locator("#joint-plot canvas").first
    page.wait_for_timeout(3000)
    gap = lambda: float(curves.evaluate(WIDEST_GAP))  # noqa: E731
    still.process.send_signal(signal.SIGSTOP)
    page.wait_for_timeout(8000)
    still.process.send_signal(signal.SIGCONT)
    expect(page.locator("#link-state")).to_contain_text("Live")
    seen = poll(gap, lambda width: width > 0.06, "a gap in the curves")
    assert np.isfinite(seen)
    context.close()
