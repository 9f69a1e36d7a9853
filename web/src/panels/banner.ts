// The lines across the page: a lost link, and the answer to what the operator asked last.

import type { App } from "../app";
import { byId, h, setText } from "../dom";
import { age } from "../format";

const NOTICE_MS = 10_000;

export function mountLinkBanner(app: App): void {
  const banner = byId("link-banner");
  const text = h("p");
  const seconds = h("span", { "aria-hidden": "true" });
  banner.append(text, seconds);
  const refresh = () => {
    const { phase, retryAtMs } = app.link.get();
    const down = phase === "lost" || phase === "silent";
    banner.hidden = !down;
    document.body.classList.toggle("link-down", phase !== "live");
    if (!down) return;
    setText(text, phase === "lost" ? "The link to the server is lost." : "The server has fallen silent.");
    const now = performance.now();
    const old = app.lastMessageMs === null ? "" : `What you see is ${age(now - app.lastMessageMs)} old. `;
    const wait = retryAtMs === null ? "" : `Reconnecting${retryAtMs > now ? ` in ${age(retryAtMs - now)}` : ""}.`;
    setText(seconds, old + wait);
  };
  app.link.watch(refresh);
  app.redraw.every(200, refresh);
}

export function mountNotices(app: App): void {
  const box = byId("notice");
  const text = h("p");
  const close = h("button", { class: "text-button", type: "button", onclick: () => (box.hidden = true) }, "Dismiss");
  box.append(text, close);
  let timer = 0;
  // What could not be done while the link was down is no news once it is back.
  app.opened.on(() => (box.hidden = true));
  app.notice.on((notice) => {
    window.clearTimeout(timer);
    box.hidden = notice === null;
    if (!notice) return;
    box.dataset["level"] = notice.level;
    setText(text, notice.text);
    timer = window.setTimeout(() => (box.hidden = true), NOTICE_MS);
  });
}
