// Keeps the 3D view's page in its frame: whatever else stands there (a refusal, an error of the browser) is replaced.

import type { App } from "./app";

/** The one address. viser adds `?websocket=` to its own, which the server refuses, so the frame is never just reloaded. */
const ADDRESS = "/viewer/";
const POLL_MS = 200;
const PAINT_MS = 50;
const FIRST_DELAY_MS = 2000;
const LAST_DELAY_MS = 16_000;
/** A busy machine or a slow link may take so long to load it. */
const LOADING_MS = 30_000;

/** What the server puts into the viewer's page and into no other; it comes early in the page. */
function isViewer(frame: HTMLIFrameElement): boolean {
  return frame.contentDocument?.querySelector('script[src="/viewer-frame.js"]') != null;
}

/** Load the view once it may be loaded, after every new sign-in, and again until it is there; `onWindow` has each one. */
export function loadViewer(app: App, frame: HTMLIFrameElement, mayLoad: () => boolean, onWindow: (inner: Window) => void): void {
  let delayMs = FIRST_DELAY_MS;
  let notBeforeMs = 0;
  let stale = true;
  const poll = () => {
    if (app.link.get().phase !== "live" || !mayLoad() || performance.now() < notBeforeMs || (!stale && isViewer(frame))) return;
    stale = false;
    notBeforeMs = performance.now() + LOADING_MS;
    // What stands in for it meanwhile is painted first.
    window.setTimeout(() => (frame.src = ADDRESS), PAINT_MS);
  };
  frame.addEventListener("load", () => {
    if (isViewer(frame) && frame.contentWindow) {
      delayMs = FIRST_DELAY_MS;
      return onWindow(frame.contentWindow);
    }
    notBeforeMs = performance.now() + delayMs;
    delayMs = Math.min(2 * delayMs, LAST_DELAY_MS);
  });
  app.link.watch(({ phase }) => {
    stale ||= phase === "signed-out";
    if (phase === "live" && stale) notBeforeMs = 0;
  });
  // Not every page that takes the frame says so: the browser's own errors may come without an event.
  window.setInterval(poll, POLL_MS);
}
