"""The page where no simulator is needed: signing in, refusals, a lost link, a small screen."""

from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser, Page, expect

from tests.server.running import START_S, TOKEN, Running, start, wait_for

pytestmark = [pytest.mark.browser, pytest.mark.alone]
PHONE = {"width": 390, "height": 844}


@pytest.fixture
def still(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    running = start(tmp_path_factory.mktemp("still"))
    with running.client() as client:
        wait_for(lambda: client.get("/api/v1/state").json()["session"] == "running", START_S)
    yield running
    running.stop()


@pytest.fixture
def page(browser: Browser, still: Running) -> Iterator[Page]:
    context = browser.new_context(viewport={"width": 1280, "height": 720}, reduced_motion="reduce")
    page = context.new_page()
    page.goto(still.url)
    yield page
    context.close()


def sign_in(page: Page) -> None:
    page.locator("#token").fill(TOKEN)
    page.keyboard.press("Enter")
    expect(page.locator("#link-state")).to_contain_text("Live")


def test_the_tab_order_of_the_page(page: Page, still: Running) -> None:
    """One server for it all: its start costs more than the checks."""
    check_signing_in(page)
    check_that_space_types_in_a_text_field(page, still)
    check_a_refusal(page)
    check_dialogs_leave_the_stop_in_reach(page)
    check_a_phone(page)
    check_the_lost_link(page, still)


def check_signing_in(page: Page) -> None:
    expect(page.locator("#signin")).to_be_visible()
    page.locator("#token").fill("a wrong one")
    page.keyboard.press("Enter")
    expect(page.locator("#signin .field-error")).to_contain_text("not the token")
    sign_in(page)
    expect(page.locator("#signin")).to_be_hidden()


def check_that_space_types_in_a_text_field(page: Page, still: Running) -> None:
    page.locator("#tab-runs").click()
    page.locator("#run-overrides").fill("")
    page.locator("#run-overrides").press_sequentially("gait.period_s=-1 a")
    expect(page.locator("#run-overrides")).to_have_value("gait.period_s=-1 a")
    with still.client() as client:
        assert not client.get("/api/v1/state").json()["estop"]["latched"]


def check_a_refusal(page: Page) -> None:
    page.locator("#run-overrides").fill("gait.period_s=-1")
    page.locator("#run-submit").click()
    expect(page.locator("#notice")).to_contain_text("gait.period_s")
    assert len(page.locator("#notice p").inner_text().splitlines()) == 1


def check_dialogs_leave_the_stop_in_reach(page: Page) -> None:
    page.locator("#source").click()
    expect(page.locator("#source-dialog")).to_be_visible()
    page.locator("#estop").click()
    expect(page.locator("#estop-reset")).to_be_visible()
    page.locator("#estop-reset").click()
    expect(page.locator("#estop-banner")).to_be_hidden()
    page.keyboard.press("Escape")
    expect(page.locator("#source-dialog")).to_be_hidden()
    expect(page.locator("#estop-banner")).to_be_hidden()


def check_a_phone(page: Page) -> None:
    before = page.viewport_size
    page.set_viewport_size(PHONE)
    for control in ("#estop", "#start", "#stop", "#viewer"):
        expect(page.locator(control)).to_be_in_viewport()
    page.locator("#events").scroll_into_view_if_needed()
    expect(page.locator("#estop")).to_be_in_viewport(ratio=1.0)
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth"), "the page is wider than the screen"
    page.set_viewport_size(before or PHONE)


def check_the_lost_link(page: Page, still: Running) -> None:
    still.stop()
    expect(page.locator("#link-banner")).to_contain_text("lost")
    expect(page.locator("#link-banner")).to_contain_text("s old")
    expect(page.locator("#start")).to_be_disabled()
    expect(page.locator('[data-gait="serpentine"]')).to_be_disabled()
    page.locator("#estop").click()
    expect(page.locator("#estop-banner")).to_contain_text("not confirmed")
