"""Holding the head still from the page, in real Chromium over the real simulator."""

from collections.abc import Iterator
from typing import Any

import httpx
import pytest
from playwright.sync_api import Page, expect

from snakeslam.runtime.robot.safety import FROZEN, LOST
from tests.e2e.conftest import Dashboard, start_moving
from tests.e2e.watching import poll

pytestmark = [pytest.mark.browser, pytest.mark.alone]


@pytest.fixture
def page(dashboard: Dashboard) -> Page:
    return dashboard.page


@pytest.fixture
def client(dashboard: Dashboard) -> Iterator[httpx.Client]:
    """A script that acts in the page's name."""
    with dashboard.server.client(headers={"Control-Lease": dashboard.take_control()}) as client:
        yield client


def state(client: httpx.Client) -> dict[str, Any]:
    return client.get("/api/v1/state").json()


def test_the_head_is_held_as_the_operator_chooses_while_moving(page: Page, client: httpx.Client) -> None:
    client.put("/api/v1/gait", json={"name": "serpentine"}).raise_for_status()
    start_moving(client)
    head = client.get("/api/v1/head").json()
    current = page.locator(f"#head-controller-{head['current']['controller']}")
    expect(current).to_have_attribute("aria-checked", "true")
    focus_every_controller(page, head)
    choose_every_available_one(page, client, head)
    set_the_neck(page, client)
    steer_where_possible(page, client)
    poll(lambda: moves(client), bool, "the robot moves")
    assert not state(client)["estop"]["latched"]
    for number in ("#head-yaw", "#head-rate", "#head-sway"):
        expect(page.locator(number)).not_to_have_text("\u2013")
    expect(page.locator("#head-yaw-detail")).to_contain_text("RMS")
    expect(page.locator("#head-rate-detail")).to_contain_text("peak")


def moves(client: httpx.Client) -> bool:
    """Whether it moves; held for a node that a busy machine left silent, and for nothing else, it is started again."""
    seen = state(client)
    if not seen["moving"]:
        assert seen["held_because"] in (*LOST.values(), FROZEN), seen["held_because"]
        client.post("/api/v1/gait/start")
    return bool(seen["moving"])


def focus_every_controller(page: Page, head: dict[str, Any]) -> None:
    """The arrow keys explain without choosing; what cannot be chosen says why."""
    names = [entry["name"] for entry in head["controllers"]]
    page.locator(f"#head-controller-{head['current']['controller']}").focus()
    for entry in head["controllers"]:
        option = page.locator(f"#head-controller-{entry['name']}")
        while page.evaluate("document.activeElement.value") != entry["name"]:
            page.keyboard.press("ArrowRight")
        expect(option).to_have_attribute("aria-disabled", str(not entry["available"]).lower())
        expect(page.locator("#head-about")).to_contain_text(entry["reason"] or entry["summary"])
        if not entry["available"]:
            page.keyboard.press("Enter")
    checked = page.locator('#head-controller [aria-checked="true"]')
    expect(checked).to_have_count(1)
    assert checked.get_attribute("value") == head["current"]["controller"]
    assert names == [option.get_attribute("value") for option in page.locator("#head-controller button").all()]


def choose_every_available_one(page: Page, client: httpx.Client, head: dict[str, Any]) -> None:
    """Each after the other by the keyboard, the present one last: the state follows."""
    names = [entry["name"] for entry in head["controllers"] if entry["available"]]
    at = names.index(head["current"]["controller"])
    for name in [*names[at + 1 :], *names[: at + 1]]:
        page.locator(f"#head-controller-{name}").press("Enter")
        poll(lambda: state(client)["head_control"]["controller"], lambda seen, name=name: seen == name, name)
        expect(page.locator(f"#head-controller-{name}")).to_have_attribute("aria-checked", "true")


def set_the_neck(page: Page, client: httpx.Client) -> None:
    neck, button = page.locator("#head-neck"), page.locator("#head-neck-set")
    expect(neck).to_have_value(str(client.get("/api/v1/head").json()["neck_joints"]["default"]))
    expect(button).to_be_disabled()
    neck.fill(str(int(neck.get_attribute("max") or 0) + 1))
    expect(neck).to_have_attribute("aria-invalid", "true")
    expect(button).to_be_disabled()
    neck.fill("5")
    button.click()
    poll(lambda: state(client)["head_control"]["neck_joints"], lambda joints: joints == 5, "a shorter neck")
    expect(page.locator("#event-list")).to_contain_text("Neck of 5 yaw joints")
    neck.fill("6")
    neck.press("Enter")
    poll(lambda: state(client)["head_control"]["neck_joints"], lambda joints: joints == 6, "the neck as it was")


def steer_where_possible(page: Page, client: httpx.Client) -> None:
    """Steering by degrees belongs to the controllers that have a line to turn."""
    before = state(client)["head_control"]["controller"]
    head = client.get("/api/v1/head").json()
    steering = next((e["name"] for e in head["controllers"] if e["steers"] and e["available"]), None)
    if steering is None or before != steering:
        expect(page.locator("#head-left")).to_be_disabled()
        expect(page.locator("#head-turn-set")).to_be_disabled()
        expect(page.locator("#head-steering")).to_contain_text("Predictive")
    if steering is None:
        return
    page.locator(f"#head-controller-{steering}").press("Enter")
    page.locator("#head-right").click()
    expect(page.locator("#event-list")).to_contain_text("Turn by 15 deg to the right")
    page.locator("#head-turn").fill("20")
    page.locator("#head-turn-set").click()
    expect(page.locator("#event-list")).to_contain_text("Turn by 20 deg to the left")
    page.locator(f"#head-controller-{before}").press("Enter")
    poll(lambda: state(client)["head_control"]["controller"], lambda seen: seen == before, before)


def test_a_gait_that_barely_advances_says_so(page: Page, client: httpx.Client) -> None:
    client.put("/api/v1/gait", json={"name": "serpentine"}).raise_for_status()
    notice = page.locator("#gait-notice")
    expect(notice).to_be_hidden()
    page.locator("#parameter-period_s").fill("8")
    page.locator("#parameter-alpha_pi").fill("0.7")
    page.locator("#gait-apply").click()
    expect(notice).to_be_visible()
    expect(notice).to_contain_text("only 11 % of its wave")
    expect(page.locator("#head-window")).to_have_text("over 8.0 s")
    page.locator("#gait-defaults").click()
    page.locator("#gait-apply").click()
    expect(notice).to_be_hidden()


def test_the_page_has_no_errors(dashboard: Dashboard) -> None:
    assert dashboard.complaints.outside == []
    assert dashboard.complaints.errors == []
