"""A robot that stopped because it saw nothing: the page says why and offers to back it up."""

from http import HTTPStatus

import pytest
from playwright.sync_api import Browser, expect

from tests.e2e.audit import Audit
from tests.server.running import START_S, TOKEN, start, wait_for
from tests.server.still_robot import COVERED_WHEN_MOVED

pytestmark = [pytest.mark.browser, pytest.mark.alone]
WHY = "the camera has seen nothing for 5 s"
LEAST_PX = 44.0


def test_the_page_offers_to_back_up(browser: Browser, tmp_path_factory: pytest.TempPathFactory) -> None:
    server = start(tmp_path_factory.mktemp("still"), seed=COVERED_WHEN_MOVED)
    context = browser.new_context(viewport={"width": 1280, "height": 720}, reduced_motion="reduce")
    with server.client() as client:
        key = wait_for(
            lambda: client.post("/api/v1/control/lease", json={"name": "a script"}).json().get("key"), START_S
        )
        client.headers["Control-Lease"] = key

        def blind() -> bool:
            client.put("/api/v1/control/lease")
            state = client.get("/api/v1/state").json()
            if not state["moving"] and state["held_because"] != WHY:
                client.post("/api/v1/gait/start")  # At first, and on a busy machine whose links are late.
            return state["held_because"] == WHY

        wait_for(blind, START_S)
        assert client.delete("/api/v1/control/lease").status_code < HTTPStatus.BAD_REQUEST
        del client.headers["Control-Lease"]
        page = context.new_page()
        page.goto(server.url)
        page.locator("#token").fill(TOKEN)
        page.keyboard.press("Enter")
        expect(page.locator("#blind-banner")).to_contain_text(WHY)
        box = page.locator("#back-up").bounding_box()
        assert box is not None
        assert min(box["width"], box["height"]) >= LEAST_PX
        audit = Audit("light", "dark")
        audit.check(page, "blind")
        assert audit.found == [], "\n".join(audit.found)
        page.locator("#back-up").click()
        wait_for(lambda: client.get("/api/v1/state").json()["gait"]["drive"] == -1.0)
        expect(page.locator("#blind-banner")).to_be_hidden()
        wait_for(lambda: not client.get("/api/v1/state").json()["moving"])
        expect(page.locator("#blind-banner")).to_be_visible()
    context.close()
    server.stop()
