"""The 3D view: framed on the robot, never blank, with tools of the viewer's own; and the patrol."""

import json
import re
from collections.abc import Iterator
from typing import Any

import httpx
import numpy as np
import pytest
from playwright.sync_api import Browser, Page, expect
from websockets.sync.client import connect

from tests.e2e.conftest import PATIENCE_MS, VIEWPORT, Dashboard
from tests.e2e.watching import look_at, poll, viewer_frame
from tests.server.running import TOKEN

pytestmark = [pytest.mark.browser, pytest.mark.alone]

CAMERA = """() => {
  const viser = window.__viserMutable;
  const root = viser.nodeRefFromName["/grid"].parent;
  const world = (read) => root.worldToLocal(read.call(viser.cameraControl, viser.camera.position.clone())).toArray();
  return {position: world(viser.cameraControl.getPosition), target: world(viser.cameraControl.getTarget)};
}"""
VISIBLE = "(name) => window.__viserMutable.nodeRefFromName[name]?.visible"
NO_WEBGL = """const native = HTMLCanvasElement.prototype.getContext;
HTMLCanvasElement.prototype.getContext = function (kind, ...more) {
  return kind.startsWith("webgl") ? null : native.call(this, kind, ...more);
};"""


@pytest.fixture
def page(dashboard: Dashboard) -> Page:
    return dashboard.page


@pytest.fixture
def drawn(page: Page) -> Page:
    """The page once the 3D view has drawn."""
    expect(page.locator("#view-loading")).to_be_hidden(timeout=2 * PATIENCE_MS)
    expect(page.locator("#top-view")).to_be_hidden()
    return page


@pytest.fixture
def client(dashboard: Dashboard) -> Iterator[httpx.Client]:
    with dashboard.server.client() as client:
        yield client


def body_centre(dashboard: Dashboard) -> np.ndarray:
    """Where the middle of the body is, from the next tick."""
    headers = {"Authorization": f"Bearer {TOKEN}"}
    with connect(
        f"{dashboard.server.websocket}/api/v1/telemetry", close_timeout=0.5, additional_headers=headers
    ) as socket:
        while True:
            raw = socket.recv(timeout=60)
            message: dict[str, Any] = json.loads(raw) if isinstance(raw, str) else {}
            if message.get("type") == "tick" and message["body"] is not None:
                return np.mean(np.reshape(message["body"]["p_m"], (-1, 3)), axis=0)


def camera(page: Page) -> dict[str, np.ndarray]:
    return {key: np.array(value) for key, value in viewer_frame(page).evaluate(CAMERA).items()}


def aimed_at_body(dashboard: Dashboard, page: Page) -> float:
    return float(np.linalg.norm(camera(page)["target"] - body_centre(dashboard)))


def another_page(browser: Browser, dashboard: Dashboard, script: str = "") -> Page:
    """A page of another browser, signed in."""
    context = browser.new_context(viewport=VIEWPORT)
    context.set_default_timeout(PATIENCE_MS)
    if script:
        context.add_init_script(script)
    context.request.post(f"{dashboard.server.url}/api/v1/session", data={"token": TOKEN})
    return context.new_page()


def test_while_the_3d_view_loads_the_robot_is_drawn_from_above_with_words(
    browser: Browser, dashboard: Dashboard
) -> None:
    page = another_page(browser, dashboard)
    page.route("**/viewer/", lambda route: route.abort())  # As long as loading may ever take.
    page.goto(dashboard.server.url)
    expect(page.locator("#view-loading")).to_contain_text("3D view: loading the program")
    poll(lambda: look_at(page.locator("#top-view")).colourful, lambda pixels: pixels > 100, "the body from above")
    expect(page.locator("#view-scale")).to_have_text(re.compile(r"^\d+ c?m$"))
    expect(page.locator("#view-top")).to_be_disabled()
    page.context.close()


def test_without_webgl_the_robot_is_drawn_from_above(browser: Browser, dashboard: Dashboard) -> None:
    page = another_page(browser, dashboard, NO_WEBGL)
    page.goto(dashboard.server.url)
    expect(page.locator("#view-loading")).to_contain_text("no WebGL")
    poll(lambda: look_at(page.locator("#top-view")).colourful, lambda pixels: pixels > 100, "the body from above")
    page.context.close()


def test_the_robot_starts_stationary_and_in_view(dashboard: Dashboard, drawn: Page, client: httpx.Client) -> None:
    state = client.get("/api/v1/state").json()
    assert not state["moving"]
    assert state["control"]["id"] is None
    assert state["head_control"]["controller"] == "predictive"
    poll(lambda: aimed_at_body(dashboard, drawn), lambda distance_m: distance_m < 0.1, "a camera on the body")
    poll(lambda: [viewer_frame(drawn).evaluate(VISIBLE, n) for n in ("/robot", "/heading")], all, "body and heading")
    expect(drawn.locator("#view-compass")).to_contain_text("x")


def test_what_is_drawn_of_the_map_is_said(drawn: Page) -> None:
    poll(
        lambda: drawn.locator("#map-points").inner_text(),
        lambda text: re.fullmatch(r"[1-9][\d.]*( k)? of [\d.]+( k)?", text),
        "points drawn of points known",
    )


def test_the_camera_goes_where_the_tools_say(dashboard: Dashboard, drawn: Page) -> None:
    def direction() -> np.ndarray:
        seen = camera(drawn)
        return (seen["target"] - seen["position"]) / np.linalg.norm(seen["target"] - seen["position"])

    drawn.locator("#view-top").click()
    poll(direction, lambda d: d[2] < -0.99, "a view from above")
    drawn.locator("#view-behind").click()
    poll(direction, lambda d: d[2] > -0.6, "a view ahead")
    drawn.locator("#view-fit").click()
    expect(drawn.locator("#view-follow")).to_have_attribute("aria-pressed", "false")
    drawn.locator("#view-reset").click()
    expect(drawn.locator("#view-follow")).to_have_attribute("aria-pressed", "true")
    poll(lambda: aimed_at_body(dashboard, drawn), lambda distance_m: distance_m < 0.1, "the camera on the body again")


def test_a_layer_is_switched_off_for_this_viewer(drawn: Page) -> None:
    frame = viewer_frame(drawn)
    drawn.locator("#view-layers").click()
    for layer, node in (("map", "/map"), ("body", "/robot"), ("camera", "/camera")):
        box = drawn.locator(f"#layer-{layer}")
        box.uncheck()
        poll(lambda node=node: frame.evaluate(VISIBLE, node), lambda on: on is False, f"no {layer}")
        box.check()
        poll(lambda node=node: frame.evaluate(VISIBLE, node), lambda on: on is True, f"the {layer} again")
    drawn.locator("#view-layers").click()


def test_two_clicks_measure_a_distance(drawn: Page) -> None:
    drawn.locator("#view-measure").click()
    plate = drawn.locator("#measure-plate")
    size = plate.bounding_box()
    assert size is not None
    for across in (0.35, 0.65):
        plate.click(position={"x": across * size["width"], "y": 0.75 * size["height"]})
    expect(drawn.locator("#measure-result")).to_have_text(re.compile(r"^\d+\.\d\d m, \d+\.\d\d m of it in height$"))
    assert float(drawn.locator("#measure-result").inner_text().split()[0]) > 0.1
    drawn.locator("#view-measure").click()
    expect(drawn.locator("#measure-result")).to_be_hidden()


def test_the_map_is_downloaded(drawn: Page) -> None:
    link = drawn.locator("#view-save")
    answer = drawn.request.get(f"{drawn.url.split('/')[0]}//{drawn.url.split('/')[2]}{link.get_attribute('href')}")
    assert answer.status == 200
    assert answer.body().startswith(b"ply")


def test_a_patrol_goes_and_the_view_follows_until_it_is_stopped(dashboard: Dashboard, drawn: Page) -> None:
    start = body_centre(dashboard)
    patrol, stop = drawn.locator("#patrol-start"), drawn.locator("#stop")
    expect(drawn.locator("#patrol")).to_have_class(re.compile("card"))

    def moved_m() -> float:
        # A machine that is too busy for camera or estimator has the robot held, which ends a patrol as well.
        if patrol.is_visible():
            patrol.click()
        return float(np.linalg.norm(body_centre(dashboard) - start))

    poll(lambda: (moved_m(), drawn.locator("#patrol-words").inner_text())[1], lambda w: "free ahead" in w, "its words")
    poll(moved_m, lambda distance_m: distance_m > 0.1, "a distance travelled")
    poll(lambda: aimed_at_body(dashboard, drawn), lambda distance_m: distance_m < 0.15, "a camera that follows")
    poll(lambda: (moved_m(), stop.is_enabled())[1], bool, "a robot to stop")
    stop.click()
    expect(drawn.locator("#patrol-words")).to_contain_text("Patrol ended")
    expect(drawn.locator("#session-state")).to_have_text("Stopped")
    expect(patrol).to_be_visible()
    drawn.locator("#control-release").click()


def test_the_view_asks_nobody_else_and_has_no_errors(dashboard: Dashboard) -> None:
    assert dashboard.complaints.outside == []
    assert dashboard.complaints.errors == []
