"""Take the README's picture of the page: ``python bench/screenshot.py [SECONDS]`` writes docs/page.png."""

import sys
import tempfile
import time
from pathlib import Path

CHECKOUT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(CHECKOUT))

from tests.e2e.chromium import chromium_path, open_chromium  # noqa: E402
from tests.e2e.conftest import start_dashboard, stop_dashboard  # noqa: E402

SIZE = {"width": 1440, "height": 900}


def main() -> None:
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 60.0
    path = chromium_path()
    if path is None:
        sys.exit("no Chromium: install it or point CHROMIUM at one")
    picture = CHECKOUT / "docs" / "page.png"
    picture.parent.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        server, url = start_dashboard(Path(folder))
        try:
            with open_chromium(path) as browser:
                page = browser.new_page(viewport=SIZE, color_scheme="dark")
                page.goto(url)
                time.sleep(seconds)
                page.screenshot(path=picture)
        finally:
            stop_dashboard(server)
    print(picture.relative_to(CHECKOUT))


if __name__ == "__main__":
    main()
