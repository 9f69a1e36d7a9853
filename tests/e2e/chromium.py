"""A real Chromium as on a laptop without a graphics card: WebGL by the processor, the page itself without GL."""

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager

from playwright.sync_api import Browser, sync_playwright

ARGUMENTS = [
    "--no-sandbox",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-default-apps",
    "--enable-unsafe-swiftshader",
]


def chromium_path() -> str | None:
    """Where Chromium is: $CHROMIUM, or the system's."""
    return shutil.which(os.environ.get("CHROMIUM") or "chromium")


@contextmanager
def open_chromium(path: str) -> Iterator[Browser]:
    """A headless browser."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=ARGUMENTS)
        try:
            yield browser
        finally:
            browser.close()
