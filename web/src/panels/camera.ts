// The camera's picture with the tracked features on top; says so when the picture stands still.

import type { App } from "../app";
import { byId, cssColour, h, setText } from "../dom";
import { age, fixed } from "../format";
import type { Frame, Track } from "../types";

const FROZEN_AFTER_MS = 1000;

export function mountCamera(app: App): void {
  const picture = h("canvas", { id: "camera-picture", role: "img", "aria-label": "Picture of the head camera" });
  const overlay = h("canvas", { id: "camera-overlay", "aria-hidden": "true" });
  const badge = h("span", { class: "picture-badge", hidden: true });
  const empty = h("p", { class: "picture-empty" }, "No picture yet");
  const rate = h("span", { class: "muted num", id: "camera-rate" });
  const toggle = h("button", { class: "toggle", type: "button", "aria-pressed": "true", id: "features-toggle" }, "Features");
  const level = h("button", { class: "toggle", type: "button", "aria-pressed": "false", id: "level-toggle" }, "Level");
  level.title = "Turn the picture upright while the head rolls";
  byId("camera").append(
    h("header", { class: "panel-head" }, h("h2", {}, "Camera"), rate, level, toggle),
    h("div", { class: "picture", id: "picture" }, picture, overlay, empty, badge),
    legend(),
  );
  const painter = new Painter(picture, overlay);
  toggle.addEventListener("click", () => {
    painter.showTracks = !painter.showTracks;
    toggle.setAttribute("aria-pressed", String(painter.showTracks));
    painter.drawTracks();
  });
  level.addEventListener("click", () => {
    painter.level = !painter.level;
    level.setAttribute("aria-pressed", String(painter.level));
    painter.turn();
  });
  let shownMs: number | null = null;
  app.frame.on((frame) => {
    painter.show(frame);
    shownMs = performance.now();
    empty.hidden = true;
  });
  app.tick.on((tick) => setText(rate, tick.frame_rate_hz === null ? "" : `${fixed(tick.frame_rate_hz, 1)} Hz`));
  app.theme.on(() => painter.drawTracks());
  window.setInterval(() => {
    const old = shownMs === null ? 0 : performance.now() - shownMs;
    badge.hidden = old < FROZEN_AFTER_MS;
    setText(badge, app.state.get()?.session === "ended" ? "Recording has ended" : `Picture is ${age(old)} old`);
  }, 250);
}

function legend(): HTMLElement {
  return h(
    "p",
    { class: "legend", id: "features-legend" },
    h("span", { class: "key key-inlier" }, "used"),
    h("span", { class: "key key-outlier" }, "rejected"),
  );
}

/** Draws the newest frame only: while one is being decoded, a newer one replaces the one that waits. */
class Painter {
  showTracks = true;
  level = false;
  private rollDeg = 0;
  private waiting: Frame | null = null;
  private busy = false;
  private tracks: Track[] = [];

  constructor(
    private readonly picture: HTMLCanvasElement,
    private readonly overlay: HTMLCanvasElement,
  ) {}

  show(frame: Frame): void {
    this.waiting = frame;
    if (!this.busy) void this.drain();
  }

  private async drain(): Promise<void> {
    this.busy = true;
    while (this.waiting) {
      const frame = this.waiting;
      this.waiting = null;
      try {
        this.paint(frame, await createImageBitmap(frame.jpeg));
      } catch (error) {
        console.warn("a camera picture could not be decoded", error);
      }
    }
    this.busy = false;
  }

  private paint(frame: Frame, image: ImageBitmap): void {
    for (const canvas of [this.picture, this.overlay]) {
      if (canvas.width !== frame.width) canvas.width = frame.width;
      if (canvas.height !== frame.height) canvas.height = frame.height;
    }
    this.picture.getContext("2d")?.drawImage(image, 0, 0, frame.width, frame.height);
    this.picture.dataset["seq"] = String(frame.seq);
    this.rollDeg = frame.roll_deg ?? this.rollDeg;
    this.turn();
    image.close();
    this.tracks = frame.tracks;
    this.drawTracks();
  }

  /** Despun: the whole picture turned against the head's roll, small enough to stay inside at any angle. */
  turn(): void {
    const { width, height } = this.picture;
    const scale = height / Math.hypot(width, height);
    const turned = this.level ? `rotate(${this.rollDeg}deg) scale(${scale.toFixed(3)})` : "";
    for (const canvas of [this.picture, this.overlay]) canvas.style.transform = turned;
  }

  /** Circles for what the estimator uses, crosses for what it rejects: the shape tells as well as the colour. */
  drawTracks(): void {
    const context = this.overlay.getContext("2d");
    if (!context) return;
    context.clearRect(0, 0, this.overlay.width, this.overlay.height);
    if (!this.showTracks) return;
    const size = Math.max(3, this.overlay.width / 150);
    context.lineWidth = Math.max(1.5, this.overlay.width / 320);
    for (const inlier of [1, 0]) {
      context.beginPath();
      for (const [x, y, kind] of this.tracks) {
        if (kind !== inlier) continue;
        if (inlier) {
          context.moveTo(x + size, y);
          context.arc(x, y, size, 0, 2 * Math.PI);
        } else {
          context.moveTo(x - size, y - size);
          context.lineTo(x + size, y + size);
          context.moveTo(x + size, y - size);
          context.lineTo(x - size, y + size);
        }
      }
      context.strokeStyle = cssColour(inlier ? "--inlier" : "--outlier");
      context.stroke();
    }
  }
}
