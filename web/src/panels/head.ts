// How still the head is held: what the camera's picture depends on.

import type { App } from "../app";
import { byId, h } from "../dom";
import { fixed, scaled } from "../format";
import { Sparkline } from "../sparkline";
import { Readout } from "./readout";

export function mountHead(app: App): void {
  const yaw = new Readout({ id: "head-yaw", label: "Yaw", unit: "\u00b0", trend: new Sparkline(300, 10, true) });
  const rate = new Readout({ id: "head-rate", label: "Yaw rate", unit: "\u00b0/s", trend: new Sparkline(300, 10, true) });
  const sway = new Readout({ id: "head-sway", label: "Sway (p\u2013p)", unit: "cm", trend: new Sparkline(300, 2) });
  yaw.root.title = "Heading of the head against the direction of travel";
  rate.root.title = "How fast the head turns; fast turns blur the picture";
  sway.root.title = "Sideways motion of the head over the last seconds, peak to peak";
  byId("head").append(
    h("header", { class: "panel-head" }, h("h2", {}, "Head stillness")),
    yaw.root,
    rate.root,
    sway.root,
  );
  app.tick.on(({ head }) => {
    yaw.set(fixed(head.yaw_deg, 1), head.yaw_deg);
    rate.set(fixed(head.yaw_rate_deg_s, 1), head.yaw_rate_deg_s);
    sway.set(scaled(head.sway_m, 100, 1), head.sway_m === null ? null : head.sway_m * 100);
  });
  window.setInterval(() => [yaw, rate, sway].forEach((readout) => readout.draw()), 200);
}
