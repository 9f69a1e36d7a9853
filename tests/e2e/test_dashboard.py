"""The page in real Chromium, over the real server and the real simulator."""

import json
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
from playwright.sync_api import Page, expect
from websockets.sync.client import connect

from tests.conftest import CHECKOUT
from tests.e2e.conftest import Dashboard, start_moving
from tests.e2e.watching import (
    drawn_points,
    look_at,
    poll,
    screenshot_rgb,
    viewer_frame,
)
from tests.server.running import START_S, TOKEN, is_ready, wait_for

pytestmark = [pytest.mark.browser, pytest.mark.alone]
RUN_TIMEOUT_S = 600.0
OVERRIDES = {"gait.alpha_pi": 0.1, "sim.camera.rate_hz": 10}
# Of what half a second moves: servos yield a little; the serpentine moves its joints by 0.4 rad.
AT_REST_RAD = 0.03


@pytest.fixture
def page(dashboard: Dashboard) -> Page:
    return dashboard.page


@pytest.fixture
def client(dashboard: Dashboard) -> Iterator[httpx.Client]:
    """A script that acts in the page's name."""
    with dashboard.server.client(headers={"Control-Lease": dashboard.take_control()}) as client:
        yield client


@pytest.fixture
def crawling(client: httpx.Client) -> None:
    """The simulator runs, nothing is latched, the serpentine gait moves."""
    if state(client)["source"]["kind"] != "sim":
        client.post("/api/v1/sim/start", json={}).raise_for_status()
        wait_for(lambda: is_ready(client), START_S)
    client.post("/api/v1/estop/reset").raise_for_status()
    client.put("/api/v1/gait", json={"name": "serpentine"}).raise_for_status()
    start_moving(client)


def state(client: httpx.Client) -> dict[str, Any]:
    return client.get("/api/v1/state").json()


@dataclass(frozen=True)
class Travel:
    """How far the joint that moves most moves, rad, as commanded and as measured."""

    target_rad: float
    measured_rad: float

    @property
    def at_rest(self) -> bool:
        return self.target_rad < 1e-3 and self.measured_rad < AT_REST_RAD


def joint_travel(dashboard: Dashboard, seconds: float = 0.5) -> Travel:
    """Watch the joints for some simulated time."""
    headers = {"Authorization": f"Bearer {TOKEN}"}
    ticks: list[dict[str, Any]] = []
    with connect(
        f"{dashboard.server.websocket}/api/v1/telemetry", close_timeout=0.5, additional_headers=headers
    ) as socket:
        while not ticks or ticks[-1]["t_s"] - ticks[0]["t_s"] < seconds:
            raw = socket.recv(timeout=60)
            message = json.loads(raw) if isinstance(raw, str) else {}
            if message.get("type") == "tick":
                ticks.append(message)
    target, measured = (np.array([tick[key] for tick in ticks]) for key in ("q_target", "q_measured"))
    return Travel(float(np.ptp(target, axis=0).max()), float(np.ptp(measured, axis=0).max()))


def test_the_printed_url_signs_in_once(dashboard: Dashboard) -> None:
    expect(dashboard.page.locator("#link-state")).to_contain_text("Live")
    expect(dashboard.page.locator("#signin")).to_be_hidden()
    with dashboard.server.anonymous() as stranger:
        stranger.get(dashboard.login_url)
        assert stranger.get("/api/v1/state").status_code == 401


@pytest.mark.usefixtures("crawling")
def test_the_3d_view_draws_a_growing_map(page: Page) -> None:
    points = page.locator("#map-points")
    first = poll(lambda: int(points.get_attribute("data-count") or 0), lambda n: n > 0, "map points")
    poll(lambda: int(points.get_attribute("data-count") or 0), lambda n: n > first, "more map points")
    frame = viewer_frame(page)
    poll(lambda: drawn_points(frame), lambda n: n > 0, "points drawn by WebGL")
    upper = screenshot_rgb(page.locator("#viewer"))[:-60]
    colours = np.unique(upper.reshape(-1, 3) // 16, axis=0)
    assert len(colours) > 20, "the 3D view is nearly one colour"


def test_the_3d_view_pauses_after_a_frame_that_took_long(page: Page) -> None:
    """So that drawing without a graphics card leaves the operator's controls their share."""
    rest_ms = viewer_frame(page).evaluate(
        """async () => {
          const now = () => performance.now();
          const busy = (ms) => { const from = now(); while (now() < from + ms); return now(); };
          const next = (work) => new Promise((done) => requestAnimationFrame(() => done(work())));
          const slow = await next(() => busy(200));
          return await next(now) - slow;
        }"""
    )
    assert rest_ms >= 1590
    antialiased = "document.createElement('canvas').getContext('webgl2').getContextAttributes().antialias"
    assert viewer_frame(page).evaluate(antialiased) is False
    assert page.evaluate(antialiased) is True


def test_the_3d_view_draws_what_is_asked_for_once(page: Page) -> None:
    called = viewer_frame(page).evaluate(
        """async () => {
          const called = [];
          const cancelled = requestAnimationFrame(() => called.push("cancelled"));
          cancelAnimationFrame(cancelled);
          requestAnimationFrame(() => called.push("first"));
          await new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)));
          return called;
        }"""
    )
    assert called == ["first"]


@pytest.mark.usefixtures("crawling")
def test_the_camera_image_is_live(page: Page) -> None:
    image = page.locator("#camera-image")
    first = poll(lambda: look_at(image), lambda look: look.variance > 25, "a camera image")
    poll(lambda: look_at(image), lambda look: look.hash != first.hash, "another camera image")
    overlay = page.locator("#camera-overlay")
    poll(lambda: look_at(overlay).drawn, lambda pixels: pixels > 300, "tracked features on the image")
    page.locator("#features-toggle").press("Enter")
    poll(lambda: look_at(overlay).drawn, lambda pixels: pixels == 0, "features switched off")
    page.locator("#features-toggle").press("Enter")


@pytest.mark.usefixtures("crawling")
def test_the_camera_image_is_rotated_upright_and_goes_on(page: Page) -> None:
    image, level = page.locator("#camera-image"), page.locator("#level-toggle")
    turned = lambda: str(image.evaluate("canvas => canvas.style.transform"))  # noqa: E731
    level.press("Enter")
    first = poll(turned, lambda transform: "rotate(" in transform, "an upright image")
    poll(turned, lambda transform: transform != first, "another roll")
    level.press("Enter")
    poll(turned, lambda transform: transform == "", "the image as it comes")


@pytest.mark.usefixtures("crawling")
def test_joint_curves_are_drawn_and_move(page: Page) -> None:
    curves = page.locator("#joint-plot canvas").first
    before = poll(lambda: look_at(curves), lambda look: look.colourful > 500, "joint curves")
    poll(lambda: look_at(curves).hash, lambda seen: seen != before.hash, "curves that move on")
    chips = page.locator(".joint-chip")
    shown = chips.count()
    page.locator(".picker summary").click()
    page.locator('.joint[data-joint="2"]').click()
    expect(chips).to_have_count(shown + 1)
    page.locator(".joint-chip", has_text="J2").last.click()
    page.locator(".picker summary").click()


@pytest.mark.usefixtures("crawling")
def test_a_gait_is_picked_and_set(page: Page, client: httpx.Client) -> None:
    page.locator('[data-gait="sidewinding"]').click()
    expect(page.locator('[data-gait="sidewinding"]')).to_have_attribute("aria-pressed", "true")
    poll(lambda: state(client)["gait"]["name"], lambda name: name == "sidewinding", "the gait picked")
    period = page.locator("#parameter-period_s")
    period.fill("6.5")
    page.locator("#gait-apply").click()
    poll(lambda: state(client)["gait"], lambda gait: gait["period_s"] == 6.5, "the period applied")
    period.fill("1000")
    expect(page.locator("#gait-apply")).to_be_disabled()
    page.locator("#gait-defaults").click()
    page.locator("#stop").click()
    expect(page.locator("#session-state")).to_have_text("Stopped")
    poll(lambda: state(client)["moving"], lambda on: not on, "the stationary robot")
    page.locator("#start").click()
    expect(page.locator("#session-state")).to_have_text("Moving")


@pytest.mark.usefixtures("crawling")
@pytest.mark.parametrize("means", ["button", "Space", "Escape"])
def test_the_emergency_stop_latches(dashboard: Dashboard, client: httpx.Client, means: str) -> None:
    page = dashboard.page
    expect(page.locator("#stop")).to_be_enabled()
    if means == "button":
        poll(lambda: joint_travel(dashboard), lambda travel: travel.measured_rad > 5 * AT_REST_RAD, "a moving robot")
    if means == "button":
        page.locator("#estop").click()
    else:
        page.locator("#stop").focus()
        page.keyboard.press(means)
    expect(page.locator("#estop-reset")).to_be_visible()
    expect(page.locator("#estop-banner")).to_contain_text("latched")
    expect(page.locator("#start")).to_be_disabled()
    poll(lambda: state(client)["estop"]["latched"], bool, "the latch")
    if means != "button":
        client.post("/api/v1/estop/reset")
        return
    joint_travel(dashboard)  # The ramp to a hold.
    assert joint_travel(dashboard).target_rad < 1e-3
    # The body, stopped in mid-air as it may be, settles on the ground.
    poll(lambda: joint_travel(dashboard), lambda travel: travel.at_rest, "rest")
    page.locator("#estop-reset").click()
    expect(page.locator("#estop-banner")).to_be_hidden()
    assert joint_travel(dashboard).at_rest, "the reset moved the robot"
    assert not state(client)["moving"]
    page.locator("#start").click()
    expect(page.locator("#session-state")).to_have_text("Moving")


@pytest.mark.usefixtures("crawling")
def test_a_run_beside_the_live_view_equals_the_command_line(page: Page, client: httpx.Client, tmp_path: Path) -> None:
    request = {"config": "sim", "overrides": OVERRIDES, "seed": 7, "duration_s": 1.5}
    answer = client.post("/api/v1/runs", json=request)
    assert answer.status_code == 202
    run = answer.json()["id"]
    sequences: list[int] = []

    def watch() -> dict[str, Any]:
        sequences.append(int(page.locator("#camera-image").get_attribute("data-seq") or 0))
        return client.get(f"/api/v1/runs/{run}").json()

    ended = poll(watch, lambda r: r["state"] not in ("queued", "running"), "the run's end", RUN_TIMEOUT_S)
    assert ended["state"] == "done", ended["error"]
    standing = longest_standstill(sequences)
    assert standing <= 20, f"the image was frozen for {standing} looks of 0.1 s and more"
    by_page = client.get(f"/api/v1/runs/{run}/artifacts/estimate.tum").raise_for_status().content
    assert by_page == estimate_of_command_line(tmp_path, request)
    page.locator("#tab-runs").click()
    row = page.locator(f'[data-run="{run}"]')
    expect(row).to_have_attribute("data-state", "done")
    expect(row.get_by_role("link", name="estimate.tum")).to_be_visible()
    page.locator("#tab-joints").click()


def longest_standstill(sequences: list[int]) -> int:
    longest = current = 0
    for before, after in pairwise(sequences):
        current = current + 1 if after == before else 0
        longest = max(longest, current)
    return longest


def estimate_of_command_line(folder: Path, request: dict[str, Any]) -> bytes:
    sets = [f"--set={key}={value}" for key, value in request["overrides"].items()]
    ends = ["--seed", str(request["seed"]), "--duration", str(request["duration_s"]), "--out", str(folder / "run")]
    command = [sys.executable, "-m", "snakeslam", "run", str(CHECKOUT / "configs" / "sim.yaml"), *sets, *ends, "--json"]
    subprocess.run(command, check=True, capture_output=True, timeout=RUN_TIMEOUT_S, env=os.environ)
    return (folder / "run" / "estimate.tum").read_bytes()


@pytest.mark.parametrize(("recording", "width_px"), [("euroc_v101_moving", 752), ("tum_fr1_rpy_part1", 640)])
@pytest.mark.usefixtures("shared_data")
def test_a_recording_is_chosen_and_plays(page: Page, client: httpx.Client, recording: str, width_px: int) -> None:
    page.locator("#source").click()
    page.locator(f'[data-recording="{recording}"]').get_by_role("button").click()
    expect(page.locator("#source")).to_contain_text(recording)
    assert state(client)["source"] == {"kind": "recording", "name": recording}
    expect(page.locator("#drive-note")).to_contain_text("no robot to drive")
    expect(page.locator("#start")).to_be_disabled()
    expect(page.locator("#estop")).to_be_enabled()
    expect(page.locator("#session-state")).to_have_text(re.compile("Ended|Failed"), timeout=120_000)
    assert state(client)["session"] == "ended", state(client)["message"]
    assert page.locator("#camera-image").evaluate("canvas => canvas.width") == width_px
    assert len(client.get("/api/v1/trajectory").json()["estimate"]) > 20, "hardly a pose"
    poll(lambda: float(page.locator("#distance").inner_text()), lambda distance_m: distance_m > 0.05, "a distance")


@pytest.mark.usefixtures("shared_data")
def test_the_return_to_the_simulator(page: Page, client: httpx.Client) -> None:
    page.locator("#source").click()
    page.locator("#sim-start").click()
    expect(page.locator("#source")).to_contain_text("Simulator")
    poll(lambda: state(client)["session"], lambda session: session == "running", "the simulator again")
    expect(page.locator("#session-state")).to_have_text("Stopped")


def test_the_page_asks_nobody_else_and_has_no_errors(dashboard: Dashboard) -> None:
    assert dashboard.complaints.outside == []
    assert dashboard.complaints.errors == []
