// The lines across the page: a lost link, and the answer to what the operator asked last.

import { api } from "../link/api";
import type { App, LinkPhase } from "../app/app";
import { byId, h, icon, setText } from "../basics/dom";
import { age } from "../basics/format";
import type { Loss } from "../app/lease";
import type { Cell } from "../basics/store";

const NOTICE_MS = 10_000;

export function mountLinkBanner(app: App): void {
  const banner = byId("link-banner");
  const text = h("p");
  const seconds = h("span", { "aria-hidden": "true" });
  banner.append(text, seconds);
  const refresh = () => {
    const { phase, retryAtMs, reason } = app.link.get();
    const down = phase === "lost" || phase === "silent";
    banner.hidden = !down;
    document.body.classList.toggle("link-down", phase !== "live");
    if (!down) return;
    setText(text, linkWords(phase, reason));
    const now = performance.now();
    const old = app.lastMessageMs === null ? "" : `What you see is ${age(now - app.lastMessageMs)} old. `;
    const wait = retryAtMs === null ? "" : `Reconnecting${retryAtMs > now ? ` in ${age(retryAtMs - now)}` : ""}.`;
    setText(seconds, old + wait);
  };
  app.link.watch(refresh);
  app.redraw.every(200, refresh);
}

/** Says that the robot has stopped because it saw nothing, and offers to back it up. */
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

function linkWords(phase: LinkPhase, reason = ""): string {
  if (phase === "silent") return `The server at ${location.host} has fallen silent.`;
  return `The link to the server at ${location.host} is lost${reason === "" ? "" : ` (${reason})`}.`;
}

/** Control that was taken away is said in large, with what can be done now, until the operator has seen it. */
export function mountTakenBanner(app: App): void {
  const banner = byId("taken-banner");
  const text = h("p");
  const back = h("button", { class: "button", type: "button", id: "taken-back" });
  const dismiss = h("button", { class: "button", type: "button", id: "taken-dismiss" }, "Dismiss");
  banner.append(icon("warn"), text, back, dismiss);
  back.addEventListener("click", () => void app.attempt(() => app.lease.take(app.state.get()?.control.id != null)));
  dismiss.addEventListener("click", () => app.lease.loss.set(null));
  app.lease.loss.watch((loss) => {
    banner.hidden = loss === null;
    if (!loss) return;
    setText(text, lossWords(loss));
    setText(back, loss.by === null ? "Take control" : "Take it back");
    back.hidden = app.role.get() === "viewer";
  });
}

function lossWords({ by, at }: Loss): string {
  const time = at.toLocaleTimeString([], { hour: "2-digit", minute: "2-digit" });
  if (by !== null) return `${by} took over control at ${time}. This page drives no more: watch, or press the emergency stop.`;
  return `Your control ended at ${time}: this page was silent for too long, or the server restarted. Take control to drive again.`;
}

/** One line that is always there: what the operator can do now, and why not more. */
export function mountStatusLine(app: App): void {
  const line = byId("status-line");
  const show = () => {
    const { text, level } = statusWords(app);
    line.dataset["level"] = level;
    setText(line, text);
  };
  for (const cell of [app.state, app.link, app.role, app.lease.current]) (cell as Cell<unknown>).watch(show);
}

function statusWords(app: App): { text: string; level: "info" | "warning" } {
  const state = app.state.get();
  const info = (text: string) => ({ text, level: "info" as const });
  if (app.link.get().phase !== "live" || !state) return info("Waiting for the server.");
  if (state.session !== "running") return info(state.message ?? { starting: "The session is starting.", ended: "The session has ended.", failed: "The session has failed." }[state.session]);
  if (state.source.kind === "recording") return info("A recording plays: there is no robot to drive.");
  if (state.estop.latched) return info("Reset the emergency stop, then start or drive.");
  if (state.held_because !== null) return { text: `The robot is held: ${state.held_because}. Start it again, or drive.`, level: "warning" };
  if (app.role.get() === "viewer") return info("You are signed in to watch. The emergency stop works for you too.");
  const { holder } = state.control;
  if (!app.lease.mine && holder !== null) return info(`${holder} has control. Take over to drive.`);
  if (state.moving) return info("The robot moves. Space, Escape or the red button stops it.");
  const prefix = app.lease.mine ? "You have control." : "Nobody has control; driving takes it.";
  return info(`${prefix} Hold W A S D or the pad to drive, or press Start.`);
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
