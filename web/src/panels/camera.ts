// The camera's image with the tracked features on top; says so when the image is frozen.

import type { App } from "../app/app";
import { byId, cssColour, h, setText } from "../basics/dom";
import { age, fixed } from "../basics/format";
import type { Telemetry } from "../app/telemetry";
import "../styles/panels/camera.css";
import type { Playback, ShownImage } from "../types";

const FROZEN_AFTER_MS = 1000;

export function mountCamera(app: App, telemetry: Telemetry): void {
  const image = h("canvas", { id: "camera-image", role: "img", "aria-label": "Image of the head camera" });
  const overlay = h("canvas", { id: "camera-overlay", "aria-hidden": "true" });
  const badge = h("span", { class: "camera-badge", hidden: true });
  const empty = h("p", { class: "camera-empty" }, "No image yet");
  const rate = h("span", { class: "muted num", id: "camera-rate" });
  const toggle = h("button", { class: "toggle", type: "button", "aria-pressed": "true", id: "features-toggle" }, "Features");
  const level = h("button", { class: "toggle", type: "button", "aria-pressed": "false", id: "level-toggle" }, "Level");
  level.title = "Turn the image upright while the head rolls";
  byId("camera").append(
    h("header", { class: "panel-head" }, h("h2", {}, "Camera"), rate, level, toggle),
    h("div", { class: "camera-stage", id: "camera-stage" }, image, overlay, empty, badge, legend()),
  );
  telemetry.drawOn(image, overlay);
  const turned = new Turned(image, overlay);
  let marked = true;
  const mark = () => telemetry.mark(marked, { inlier: cssColour("--inlier"), outlier: cssColour("--outlier") });
  toggle.addEventListener("click", () => {
    marked = !marked;
    toggle.setAttribute("aria-pressed", String(marked));
    mark();
  });
  level.addEventListener("click", () => {
    const on = turned.toggle();
    level.setAttribute("aria-pressed", String(on));
    telemetry.setLevel(on);
  });
  mark();
  app.theme.on(mark);
  let shownMs: number | null = null;
  app.image.on((shown) => {
    shownMs = shown.shown_ms - performance.timeOrigin;
    image.dataset["seq"] = String(shown.seq);
    turned.turn(shown);
    empty.hidden = true;
  });
  app.cleared.on(() => {
    shownMs = null;
    delete image.dataset["seq"];
    empty.hidden = false;
    telemetry.clear();
  });
  let rateHz: number | null = null;
  // Ticks say how a recording plays; the state is sent anew only when something else changes.
  let playback: Playback | null = null;
  app.state.watch((state) => (playback = state?.playback ?? null));
  app.tick.on((tick) => {
    rateHz = tick.frame_rate_hz;
    playback = tick.playback;
  });
  app.redraw.every(200, () => {
    setText(rate, rateHz === null ? "" : `${fixed(rateHz, 1)} Hz`);
    const old = shownMs === null ? 0 : performance.now() - shownMs;
    badge.hidden = old < FROZEN_AFTER_MS;
    setText(badge, standing(playback) ?? `Picture is ${age(old)} old`);
  });
}

/** Why a recording's image stands still; null where it should not. */
function standing(playback: Playback | null): string | null {
  if (playback?.at_end) return "Recording has ended";
  return playback?.paused ? "Paused" : null;
}

function legend(): HTMLElement {
  return h(
    "p",
    { class: "legend", id: "features-legend" },
    h("span", { class: "key key-inlier" }, "used"),
    h("span", { class: "key key-outlier" }, "rejected"),
  );
}

/** Despun: the whole image turned against the head's roll, small enough to stay inside at any angle. */
class Turned {
  private level = false;
  private last: ShownImage | null = null;

  constructor(
    private readonly image: HTMLCanvasElement,
    private readonly overlay: HTMLCanvasElement,
  ) {}

  toggle(): boolean {
    this.level = !this.level;
    if (this.last) this.turn(this.last);
    return this.level;
  }

  turn(shown: ShownImage): void {
    const roll_deg = shown.roll_deg ?? this.last?.roll_deg ?? 0;
    this.last = { ...shown, roll_deg };
    const scale = shown.height / Math.hypot(shown.width, shown.height);
    const turned = this.level ? `rotate(${roll_deg}deg) scale(${scale.toFixed(3)})` : "";
    for (const canvas of [this.image, this.overlay])
      if (canvas.style.transform !== turned) canvas.style.transform = turned;
  }
}
