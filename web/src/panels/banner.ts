// The lines across the page: a lost link, and the answer to what the operator asked last.

import { api } from "../api";
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

/** Says that the robot has stopped because it saw nothing, and offers the way back. */
export function mountBlindBanner(app: App): void {
  const banner = byId("blind-banner");
  const text = h("p");
  const back = h("button", { class: "button back-up", type: "button", id: "back-up" }, "Back up");
  banner.append(text, back);
  back.addEventListener("click", () => void app.command(() => api.backUp()));
  const sync = () => {
    const state = app.state.get();
    banner.hidden = state?.back_up_offered !== true;
    if (banner.hidden) return;
    setText(text, `Stopped: ${state?.held_because ?? "the camera still sees nothing"}. Back up, or start again.`);
    back.disabled = !app.commandable;
  };
  app.state.watch(sync);
  app.link.watch(sync);
  app.role.watch(sync);
  app.lease.current.watch(sync);
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
