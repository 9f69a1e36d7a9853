// The 3D view: viser in a frame of the same origin.

import type { App } from "../app";
import { byId, h, icon, setText } from "../dom";
import { count } from "../format";

export function mountViewer(app: App, onWindow: (frame: Window) => void): void {
  const frame = byId("viewer") as HTMLIFrameElement;
  const cover = byId("viewer-cover");
  const words = h("p");
  cover.append(icon("cube"), words);
  frame.addEventListener("load", () => {
    const inner = frame.contentDocument;
    if (!inner || !frame.contentWindow || frame.src === "") return;
    // viser only reconnects while its document has the focus, which a frame seldom has.
    inner.hasFocus = () => true;
    onWindow(frame.contentWindow);
  });
  app.link.watch(({ phase }) => {
    if (phase === "live" && !frame.hasAttribute("src")) frame.src = "/viewer/";
  });
  app.state.watch((state) => {
    const starting = !state || state.session === "starting";
    cover.hidden = !starting && state?.session !== "failed";
    cover.dataset["kind"] = state?.session ?? "starting";
    if (state?.session === "failed") setText(words, state.message ?? "The session has failed.");
    else setText(words, state?.message ?? "Starting ...");
  });
  const points = byId("map-points");
  let mapPoints = 0;
  app.tick.on((tick) => (mapPoints = tick.map_points));
  app.redraw.every(200, () => {
    setText(points, count(mapPoints));
    points.dataset["count"] = String(mapPoints);
  });
}

/** Load the viewer again, after signing in. */
export function reloadViewer(): void {
  const frame = byId("viewer") as HTMLIFrameElement;
  if (frame.hasAttribute("src")) frame.contentWindow?.location.reload();
}
