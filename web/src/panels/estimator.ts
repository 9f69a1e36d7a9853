// The estimator's health in words, and the numbers behind it.

import type { App } from "../app/app";
import { type IconName, byId, h, icon, setText } from "../basics/dom";
import { capitalised, fixed, scaled } from "../basics/format";
import { onGap } from "../app/history";
import { Sparkline } from "../drawing/sparkline";
import "../styles/panels/estimator.css";
import type { Health, RobotState, Tick, Verdict } from "../types";
import { Readout } from "./readout";

const WORDS: Record<Verdict, { title: string; meaning: string; icon: IconName }> = {
  initialising: { title: "Initialising", meaning: "Finding the first pose", icon: "dots" },
  good: { title: "Good", meaning: "The pose rests on the camera", icon: "check" },
  degraded: { title: "Degraded", meaning: "The pose is less certain", icon: "warn" },
  blind: { title: "Blind", meaning: "No help from the camera, drifting", icon: "cross" },
  lost: { title: "Lost", meaning: "The pose cannot be trusted", icon: "cross" },
};

const NEW_MAP = "New map, not connected to the old one";

const MODES: Record<string, string> = {
  visual: "visual (camera only)",
  vio: "visual-inertial",
  planar: "planar filter",
  fused: "visual-inertial + gait",
  gait: "gait only",
};

export function mountEstimator(app: App): void {
  const mark = h("span", { class: "verdict-icon" });
  const title = h("strong", { id: "verdict" });
  const why = h("p", { class: "verdict-why", id: "verdict-reasons" });
  const mode = h("span", { class: "muted", id: "estimator-mode" });
  const box = h("div", { class: "verdict", role: "status", "aria-live": "polite" }, mark, h("div", {}, title, why));
  const tracks = new Readout({ id: "tracks", label: "Tracked features", unit: "", trend: new Sparkline(300, 40) });
  const error = new Readout({ id: "error", label: "Error", unit: "cm", trend: new Sparkline(300, 1) });
  const governor = h("p", { class: "governor", id: "governor", role: "status", hidden: true });
  const distance = new Readout({ id: "distance", label: "Path of the head", unit: "m" });
  distance.root.title = "Length of the path of the head, its swaying included";
  error.root.title = "Position error of the estimate against the simulator's truth";
  byId("estimator").append(
    h("header", { class: "panel-head" }, h("h2", {}, "Estimator"), mode),
    box,
    tracks.root,
    error.root,
    distance.root,
    governor,
  );
  app.cleared.on(() => {
    for (const readout of [tracks, error, distance]) readout.clear();
  });
  const show = (health: Health) => {
    const apart = !health.map_connected && (health.verdict === "good" || health.verdict === "degraded");
    const shown = apart ? "degraded" : health.verdict;
    const words = apart ? { ...WORDS.degraded, title: NEW_MAP } : WORDS[health.verdict];
    byId("new-map-key").hidden = health.map_connected;
    if (box.dataset["verdict"] !== shown) mark.replaceChildren(icon(words.icon));
    box.dataset["verdict"] = shown;
    setText(title, words.title);
    setText(why, health.reasons.length > 0 ? capitalised(health.reasons.join("; ")) : words.meaning);
    // Two lines are shown, so that nothing below moves.
    why.title = why.textContent ?? "";
  };
  const onState = (state: RobotState | null) => {
    if (!state) return;
    show(state.health);
    setText(mode, MODES[state.estimator.mode] ?? state.estimator.mode);
  };
  const onTick = (tick: Tick) => {
    show(tick.health);
    tracks.set(String(tick.health.tracks), tick.health.tracks);
    error.set(scaled(tick.error_m, 100, 1), tick.error_m === null ? null : tick.error_m * 100);
    governor.hidden = tick.governor === null;
    if (tick.governor) {
      governor.dataset["phase"] = tick.governor.phase;
      setText(governor, governorWords(tick.governor));
    }
    distance.set(fixed(tick.distance_m, 2));
  };
  app.state.watch(onState);
  onGap(app, () => [tracks, error].forEach((readout) => readout.gap()));
  app.tick.on(onTick);
  app.redraw.every(200, () => [tracks, error, distance].forEach((readout) => readout.draw()));
}

/** What the governor does and why; the pace in steps of 5 %, so that it is not read out at every tick. */
function governorWords({ pace, phase, reason }: NonNullable<Tick["governor"]>): string {
  if (phase === "full") return "Governor: full pace";
  const share = `${5 * Math.round(20 * pace)} % of the pace`;
  const words = { slowing: "slowing to", slow: "slowed to", returning: "giving back, at" }[phase];
  return `Governor: ${words} ${share}${reason ? ` (${reason})` : ""}`;
}
