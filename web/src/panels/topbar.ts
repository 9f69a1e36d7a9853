// The top bar: what is connected, how fresh it is, and how fast it runs. (The emergency stop has its own module.)

import type { App, Link } from "../app";
import { type IconName, byId, h, icon, setText } from "../dom";
import { age, clock, fixed } from "../format";
import { shownTheme, toggleTheme } from "../theme";
import type { RobotState } from "../types";

const REFRESH_MS = 200;

function chip(id: string, label: string): { root: HTMLElement; value: HTMLElement } {
  const value = h("span", { class: "chip-value", id });
  return { root: h("div", { class: "chip" }, h("span", { class: "chip-label" }, label), value), value };
}

function linkWords(link: Link, lastMs: number | null, now: number): string {
  const since = lastMs === null ? "" : age(now - lastMs);
  if (link.phase === "live") return `Live, ${since}`;
  if (link.phase === "connecting") return "Connecting";
  if (link.phase === "signed-out") return "Signed out";
  return since === "" ? "No link" : `Lost, ${since}`;
}

function sessionWords(state: RobotState | null): string {
  if (!state) return "\u2013";
  if (state.session === "running" && state.source.kind === "sim") return state.moving ? "Moving" : "At rest";
  const words = { running: "Playing", starting: "Starting", ended: "Ended", failed: "Failed" };
  return words[state.session];
}

export function mountTopbar(app: App, openHelp: () => void): void {
  const link = chip("link-state", "Link");
  const session = chip("session-state", "Session");
  const time = chip("session-time", "Time");
  const factor = chip("realtime-factor", "Real time");
  const dot = h("span", { class: "dot", "aria-hidden": "true" });
  link.value.before(dot);
  byId("chips").append(link.root, session.root, time.root, factor.root);

  const theme = iconButton("moon", "Switch between dark and light", () => {
    toggleTheme();
    app.theme.emit();
  });
  const paintTheme = () => theme.replaceChildren(icon(shownTheme() === "dark" ? "sun" : "moon"));
  paintTheme();
  byId("tools").append(iconButton("help", "Keys and help", openHelp), theme);

  let last: { t_s: number; realtime_factor: number | null } | null = null;
  app.tick.on((tick) => (last = tick));
  app.theme.on(paintTheme);
  app.state.watch((state) => {
    last = state;
    setText(session.value, sessionWords(state));
    session.value.dataset["session"] = state?.session ?? "starting";
  });
  const refresh = () => {
    const now = app.link.get();
    setText(link.value, linkWords(now, app.lastMessageMs, performance.now()));
    dot.dataset["phase"] = now.phase;
    setText(time.value, clock(last?.t_s));
    setText(factor.value, last ? `${fixed(last.realtime_factor, 2)} \u00d7` : "\u2013");
  };
  window.setInterval(refresh, REFRESH_MS);
  app.link.watch(refresh);
}

function iconButton(name: IconName, label: string, onclick: () => void): HTMLButtonElement {
  return h("button", { class: "icon-button", type: "button", "aria-label": label, title: label, onclick }, icon(name));
}
