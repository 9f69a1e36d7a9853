// How still the head is held: the sharpness of the camera's image depends on it.

import type { App } from "../app/app";
import { byId, h, setText } from "../basics/dom";
import { fixed, scaled } from "../basics/format";
import { onGap } from "../app/history";
import { Sparkline } from "../drawing/sparkline";
import { Readout } from "./readout";
import type { Tick } from "../types";

export function mountHead(app: App): void {
  const trend = (least: number, symmetric = false) => new Sparkline(300, least, symmetric);
  const yaw = new Readout({ id: "head-yaw", label: "Yaw", unit: "\u00b0", trend: trend(10, true), detail: true });
  const rate = new Readout({ id: "head-rate", label: "Yaw rate", unit: "\u00b0/s", trend: trend(10, true), detail: true });
  const sway = new Readout({ id: "head-sway", label: "Sway", unit: "cm", trend: trend(2), detail: true });
  yaw.root.title = "Heading of the head against its mean heading";
  rate.root.title = "How fast the head rotates; fast rotations blur the image";
  sway.root.title = "Motion of the head across its direction of travel, peak to peak";
  const over = h("span", { class: "muted num", id: "head-window" });
  const heading = h("span", { class: "muted num", id: "head-heading", title: "Mean heading; left is positive" });
  byId("head").append(
    h("header", { class: "panel-head" }, h("h2", {}, "Head stillness"), heading, over),
    yaw.root,
    rate.root,
    sway.root,
  );
  onGap(app, () => [yaw, rate, sway].forEach((readout) => readout.gap()));
  let last: Tick["head"] | null = null;
  app.tick.on(({ head }) => {
    yaw.set(fixed(head.yaw_deg, 1), head.yaw_deg);
    yaw.setDetail(`RMS ${fixed(head.yaw_rms_deg, 1)}\u00b0`);
    rate.set(fixed(head.yaw_rate_deg_s, 1), head.yaw_rate_deg_s);
    rate.setDetail(`peak ${fixed(head.peak_yaw_rate_deg_s, 0)}\u00b0/s`);
    sway.set(scaled(head.sway_m, 100, 1), head.sway_m === null ? null : head.sway_m * 100);
    sway.setDetail("peak to peak");
    last = head;
  });
  app.cleared.on(() => {
    for (const readout of [yaw, rate, sway]) readout.clear();
  });
  app.redraw.every(200, () => {
    if (!last) return;
    for (const readout of [yaw, rate, sway]) readout.draw();
    setText(heading, `heading ${fixed(last.heading_deg, 0)}\u00b0`);
    setText(over, last.window_s === null ? "" : `over ${fixed(last.window_s, 1)} s`);
  });
}
