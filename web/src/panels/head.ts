// How still the head is held: what the camera's picture depends on.

import type { App } from "../app";
import { byId, h, setText } from "../dom";
import { fixed, scaled } from "../format";
import { Sparkline } from "../sparkline";
import { Readout } from "./readout";

export function mountHead(app: App): void {
  const swayTrend = new Sparkline(300, 2, true);
  const yaw = new Readout({ id: "head-yaw", label: "Yaw", unit: "\u00b0", trend: new Sparkline(300, 10, true) });
  const rate = new Readout({ id: "head-rate", label: "Yaw rate", unit: "\u00b0/s", trend: new Sparkline(300, 10, true) });
  const sway = new Readout({ id: "head-sway", label: "Sway", unit: "cm", trend: swayTrend });
  yaw.root.title = "Heading of the head against the direction of travel";
  rate.root.title = "How fast the head turns; fast turns blur the picture";
  sway.root.title = "Sideways distance of the head from the line of travel";
  const span = h("span", { class: "muted num" });
  byId("head").append(
    h("header", { class: "panel-head" }, h("h2", {}, "Head stillness"), span),
    yaw.root,
    rate.root,
    sway.root,
  );
  app.tick.on(({ head }) => {
    yaw.set(fixed(head.yaw_deg, 1), head.yaw_deg);
    rate.set(fixed(head.yaw_rate_deg_s, 1), head.yaw_rate_deg_s);
    sway.set(scaled(head.sway_m, 100, 1), head.sway_m === null ? null : head.sway_m * 100);
  });
  window.setInterval(() => {
    [yaw, rate, sway].forEach((readout) => readout.draw());
    setText(span, swayTrend.span === null ? "" : `${fixed(swayTrend.span, 1)} cm peak to peak`);
  }, 200);
}
