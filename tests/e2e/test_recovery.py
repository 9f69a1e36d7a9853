"""The page after something has failed: signed out, a server that came back as another, requests without an answer."""

import re
from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser, Page, expect

from tests.server.running import START_S, TOKEN, VIEWER_TOKEN, Running, start, wait_for

pytestmark = [pytest.mark.browser, pytest.mark.alone]
# The usual limit of 10 s runs out after a second.
HURRY = """() => {
    const limit = AbortSignal.timeout.bind(AbortSignal);
    AbortSignal.timeout = (ms) => limit(ms === 10000 ? 1000 : ms);
}"""
# The answer's head comes, its body does not.
STALLED_BODY = """() => {
    const whole = window.fetch;
    window.fetch = (path, options) => {
        if (!String(path).endsWith('/gait/start')) return whole(path, options);
        const body = new ReadableStream({
            start: (stream) => options.signal.addEventListener('abort', () => stream.error(options.signal.reason)),
        });
        return Promise.resolve(new Response(body));
    };
}"""


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    running = start(tmp_path_factory.mktemp("recovery"))
    wait_running(running)
    yield running
    running.stop()


def wait_running(running: Running) -> None:
    with running.client() as client:
        wait_for(lambda: client.get("/api/v1/state").json()["session"] == "running", START_S)


@pytest.fixture
def page(browser: Browser, running: Running) -> Iterator[Page]:
    context = browser.new_context(viewport={"width": 1280, "height": 800}, reduced_motion="reduce")
    context.request.post(f"{running.url}/api/v1/session", data={"token": TOKEN})
    page = context.new_page()
    page.goto(running.url)
    expect(page.locator("#link-state")).to_contain_text("Live")
    yield page
    context.close()


def wait_for_the_view(page: Page) -> None:
    """For the viewer's own page in its frame."""
    expect(page.frame_locator("#viewer").locator('script[src="/viewer-frame.js"]')).to_be_attached()


def answer_with_another_gait(page: Page, running: Running) -> None:
    """As a server with another configuration would."""
    with running.client() as client:
        body = client.get("/api/v1/gait").json()
    body["catalogue"][0]["title"] = "Quite another gait"
    page.route("**/api/v1/gait", lambda route: route.fulfill(json=body))


def test_a_frame_that_was_refused_recovers_by_itself(page: Page) -> None:
    wait_for_the_view(page)
    with page.expect_response(re.compile("websocket=")) as refused:
        page.evaluate("document.getElementById('viewer').contentWindow.location = '/viewer/?websocket=ws://elsewhere'")
    assert refused.value.status == 400
    wait_for_the_view(page)


def test_every_failed_request_says_what_where_and_what_to_do(page: Page) -> None:
    notice = page.locator("#notice p")
    page.locator("#control-take").click()
    expect(page.locator("#control-state")).to_have_text("You")
    page.evaluate(HURRY)
    page.route("**/gait/start", lambda _: None)
    page.locator("#start").click()
    expect(notice).to_contain_text("Starting the robot failed: no answer to POST /api/v1/gait/start at 127.0.0.1")
    expect(notice).to_contain_text("Look whether it has happened")
    page.unroute("**/gait/start")
    page.route("**/gait/start", lambda route: route.abort())
    page.locator("#start").click()
    expect(notice).to_contain_text("cannot be reached. Check that the server runs")
    page.unroute("**/gait/start")
    page.route("**/gait/start", lambda route: route.fulfill(status=502, body="<h1>Bad gateway</h1>"))
    page.locator("#start").click()
    expect(notice).to_contain_text("Starting the robot failed: the server answered 502")
    page.unroute("**/gait/start")
    page.evaluate(STALLED_BODY)
    page.locator("#start").click()
    expect(notice).to_contain_text("no answer to POST /api/v1/gait/start")
    page.route("**/recordings", lambda route: route.fulfill(status=200, body="no JSON"))
    page.locator("#source").click()
    expect(page.locator(".recordings")).to_contain_text("Reading the list of recordings failed")
    expect(page.locator(".recordings")).to_contain_text("is not JSON")


def test_signing_in_again_brings_view_role_and_gaits(page: Page, running: Running) -> None:
    """The last test: it ends the server that the others share."""
    wait_for_the_view(page)
    expect(page.locator("#control-take")).to_be_visible()
    answer_with_another_gait(page, running)
    page.context.clear_cookies()
    port = int(running.url.rsplit(":", 1)[1])
    running.stop()
    again = start(running.folder, port=port)
    try:
        wait_running(again)
        page.locator("#token").fill(VIEWER_TOKEN)
        page.keyboard.press("Enter")
        expect(page.locator("#link-state")).to_contain_text("Live")
        expect(page.locator("#control-holder")).to_contain_text("You may only watch")
        expect(page.locator("#control-take")).to_be_hidden()
        expect(page.locator(".gait-card").first).to_contain_text("Quite another gait")
        wait_for_the_view(page)
    finally:
        page.context.close()
        again.stop()
