// The top bar: what is connected, how fresh it is, and how fast it runs. (The emergency stop has its own module.)

import type { App, Link } from "../app/app";
import { type IconName, byId, h, icon, setText } from "../basics/dom";
import { age, clock, fixed } from "../basics/format";
import { shownTheme, toggleTheme } from "../basics/theme";
import type { RobotState } from "../types";
import { controlChip } from "./control";

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
  if (state.session === "running" && state.source.kind === "sim") return state.moving ? "Moving" : "Stopped";
  const words = { running: "Playing", starting: "Starting", ended: "Ended", failed: "Failed" };
  return words[state.session];
}

export function mountTopbar(app: App, openHelp: () => void): void {
  const control = chip("control-state", "Control");
  const link = chip("link-state", "Link");
  const trip = chip("round-trip", "Round trip");
  const command = chip("command-age", "Command");
  const rate = chip("frame-rate", "Camera");
  const session = chip("session-state", "Session");
  const time = chip("session-time", "Time");
  const factor = chip("realtime-factor", "Real time");
  const dot = h("span", { class: "dot", "aria-hidden": "true" });
  link.value.before(dot);
  trip.root.title = "From the page to the server and back";
  command.root.title = "From the last drive input to the session's answer that it was obeyed";
  for (const minor of [trip, command, rate, time]) minor.root.classList.add("chip-minor");
  const order = [control, link, trip, command, session, time, factor, rate];
  byId("chips").append(...order.map(({ root }) => root));

  const theme = iconButton("moon", "Switch between dark and light", () => {
    toggleTheme();
    app.theme.emit();
  });
  const paintTheme = () => theme.replaceChildren(icon(shownTheme() === "dark" ? "sun" : "moon"));
  paintTheme();
  byId("tools").append(iconButton("help", "Keys and help", openHelp), theme);

  let last: { t_s: number; realtime_factor: number | null } | null = null;
  let rateHz: number | null = null;
  app.tick.on((tick) => {
    last = tick;
    rateHz = tick.frame_rate_hz;
  });
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
    setText(control.value, controlChip(app));
    setText(trip.value, milliseconds(app.roundTripMs.get()));
    setText(command.value, milliseconds(app.commandMs.get()));
    setText(rate.value, rateHz === null ? "\u2013" : `${fixed(rateHz, 1)} Hz`);
    setText(time.value, clock(last?.t_s));
    setText(factor.value, last ? `${fixed(last.realtime_factor, 2)} \u00d7` : "\u2013");
  };
  app.redraw.every(REFRESH_MS, refresh);
  app.link.watch(refresh);
}

function milliseconds(value: number | null): string {
  return value === null ? "\u2013" : `${fixed(value, 0)} ms`;
}

function iconButton(name: IconName, label: string, onclick: () => void): HTMLButtonElement {
  return h("button", { class: "icon-button", type: "button", "aria-label": label, title: label, onclick }, icon(name));
}
