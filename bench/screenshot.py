"""Take the README's image of the page: ``python bench/screenshot.py [SECONDS] [FILE]`` writes docs/page.png."""

import sys
import tempfile
import time
from pathlib import Path

CHECKOUT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(CHECKOUT))

from tests.e2e.chromium import chromium_path, open_chromium  # noqa: E402
from tests.e2e.conftest import start_dashboard, start_moving, stop_dashboard, wait_until_running  # noqa: E402
from tests.server.running import Running  # noqa: E402

SIZE = {"width": 1440, "height": 900}
DRAW_MS = 5000


def main() -> None:
    simulated_s = float(sys.argv[1]) if len(sys.argv) > 1 else 15.0
    image = Path(sys.argv[2]) if len(sys.argv) > 2 else CHECKOUT / "docs" / "page.png"
    path = chromium_path()
    if path is None:
        sys.exit("no Chromium: install it or point CHROMIUM at one")
    image.parent.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        server, url = start_dashboard(Path(folder))
        try:
            wait_until_running(server)
            with open_chromium(path) as browser:
                page = browser.new_page(viewport=SIZE, color_scheme="dark")
                page.goto(url)
                start_gait(server)
                wait_until_simulated(server, simulated_s)
                page.wait_for_timeout(DRAW_MS)
                page.screenshot(path=image)
        finally:
            stop_dashboard(server)
    print(image)


def start_gait(server: Running) -> None:
    """Take control for the image; the robot starts stationary."""
    with server.client() as client:
        lease = client.post("/api/v1/control/lease", json={"name": "image", "seconds": 3600}).raise_for_status()
        client.headers["Control-Lease"] = lease.json()["key"]
        start_moving(client)


def wait_until_simulated(server: Running, simulated_s: float) -> None:
    with server.client() as client:
        while client.get("/api/v1/state").json()["t_s"] < simulated_s:
            time.sleep(1.0)


if __name__ == "__main__":
    main()
