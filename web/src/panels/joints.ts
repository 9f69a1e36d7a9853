// Joint curves: the chosen joints commanded (dashed) and measured (solid), and an overview of all of them.

import uPlot from "uplot";
import "uplot/dist/uPlot.min.css";
import type { App } from "../app";
import { byId, cssColour, h, icon, setText } from "../dom";
import { JointHistory } from "../history";
import { Heatmap } from "./heatmap";

const WINDOW_S = 20;
const REDRAW_MS = 120;
const MOST_CHOSEN = 6;

export function mountJoints(app: App): void {
  const panel = new JointsPanel();
  app.tick.on((tick) => panel.history.push(tick));
  app.theme.on(() => panel.rebuild());
  window.setInterval(() => panel.refresh(), REDRAW_MS);
}

class JointsPanel {
  readonly history = new JointHistory(WINDOW_S);
  private chosen: number[] = [];
  private paused = false;
  private plot: uPlot | null = null;
  private joints = 0;
  private readonly holder = h("div", { class: "plot", id: "joint-plot" });
  private readonly chips = h("div", { class: "joint-chips", "aria-label": "Chosen joints" });
  private readonly grid = h("div", { class: "joint-grid" });
  private readonly scale = h("span", { class: "muted num" });
  private readonly heatmap = new Heatmap((joint) => this.toggle(joint));
  private readonly pause = h("button", { class: "toggle", type: "button", "aria-pressed": "false", id: "joints-pause" }, "Pause");

  constructor() {
    this.pause.addEventListener("click", () => {
      this.paused = !this.paused;
      this.pause.setAttribute("aria-pressed", String(this.paused));
    });
    byId("joints").append(
      h(
        "div",
        { class: "plot-bar" },
        this.chips,
        h("span", { class: "line-key" }, h("i", { class: "solid" }), "meas. ", h("i", { class: "dashed" }), "cmd."),
        h("details", { class: "picker" }, h("summary", {}, "Choose joints", icon("chevron")), this.grid),
        this.pause,
      ),
      h(
        "div",
        { class: "plots" },
        this.holder,
        h(
          "figure",
          { class: "overview" },
          this.heatmap.canvas,
          h("figcaption", {}, "All joints, head up", this.scale),
        ),
      ),
    );
    new ResizeObserver(() => this.resize()).observe(this.holder);
  }

  refresh(): void {
    if (this.history.joints !== this.joints) this.adopt(this.history.joints);
    if (this.paused || this.holder.clientWidth === 0 || this.history.samples.length === 0) return;
    this.plot?.setData(this.data());
    const reach = this.heatmap.draw(this.history);
    setText(this.scale, `\u00b1${reach}\u00b0`);
  }

  /** Another robot: offer its joints and choose a yaw joint near the tail, the middle and the head. */
  private adopt(joints: number): void {
    this.joints = joints;
    this.heatmap.clear();
    const odd = (share: number) => Math.max(1, 2 * Math.floor((joints * share) / 2) + 1);
    this.chosen = [...new Set([odd(0.15), odd(0.5), odd(0.85)])].filter((joint) => joint <= joints);
    this.grid.replaceChildren(
      ...Array.from({ length: joints }, (_, index) => {
        const joint = index + 1;
        const kind = joint % 2 === 1 ? "yaw" : "pitch";
        return h(
          "button",
          { class: "joint", type: "button", "data-joint": joint, title: kind, onclick: () => this.toggle(joint) },
          String(joint),
        );
      }),
    );
    this.rebuild();
  }

  private toggle(joint: number): void {
    if (this.chosen.includes(joint)) this.chosen = this.chosen.filter((other) => other !== joint);
    else this.chosen = [...this.chosen, joint].slice(-MOST_CHOSEN);
    this.rebuild();
  }

  rebuild(): void {
    this.chips.replaceChildren(...this.chosen.map((joint, index) => this.chip(joint, index)));
    for (const button of this.grid.children) {
      const on = this.chosen.includes(Number((button as HTMLElement).dataset["joint"]));
      button.setAttribute("aria-pressed", String(on));
    }
    this.plot?.destroy();
    const { clientWidth: width, clientHeight: height } = this.holder;
    this.plot = width === 0 || this.joints === 0 ? null : new uPlot(this.options(width, height), this.data(), this.holder);
  }

  private chip(joint: number, index: number): HTMLElement {
    const kind = joint % 2 === 1 ? "yaw" : "pitch";
    const label = `Joint ${joint}, ${kind}: remove from the plot`;
    return h(
      "button",
      { class: `joint-chip series-${index}`, type: "button", "aria-label": label, onclick: () => this.toggle(joint) },
      h("i", { "aria-hidden": "true" }),
      `J${joint}`,
      h("small", {}, kind),
    );
  }

  private data(): uPlot.AlignedData {
    const { samples, end_s } = this.history;
    const columns: number[][] = [samples.map((sample) => sample.t_s - end_s)];
    for (const joint of this.chosen) {
      columns.push(samples.map((sample) => sample.target[joint - 1] ?? 0));
      columns.push(samples.map((sample) => sample.measured[joint - 1] ?? 0));
    }
    return columns as uPlot.AlignedData;
  }

  private options(width: number, height: number): uPlot.Options {
    const axis = { stroke: cssColour("--muted"), grid: { stroke: cssColour("--grid"), width: 1 }, ticks: { show: false } };
    const font = "11px system-ui, sans-serif";
    const series: uPlot.Series[] = [{}];
    this.chosen.forEach((_, index) => {
      const stroke = cssColour(`--series-${index}`);
      series.push({ stroke, width: 1.2, dash: [5, 4], points: { show: false } });
      series.push({ stroke, width: 2, points: { show: false } });
    });
    return {
      width,
      height,
      series,
      legend: { show: false },
      cursor: { show: false },
      padding: [8, 14, 0, 0],
      scales: { x: { time: false, range: [-WINDOW_S, 0] }, y: { range: (_, low, high) => paddedRange(low, high) } },
      axes: [
        { ...axis, font, size: 26, values: (_, ticks) => ticks.map((tick) => (tick === 0 ? "now" : `${tick} s`)) },
        { ...axis, font, size: 44, values: (_, ticks) => ticks.map((tick) => `${tick}\u00b0`) },
      ],
    };
  }

  private resize(): void {
    const { clientWidth: width, clientHeight: height } = this.holder;
    if (width === 0 || height === 0) return;
    if (this.plot) this.plot.setSize({ width, height });
    else this.rebuild();
  }
}

/** At least +-5 deg, so that a robot at rest shows flat lines and not magnified noise. */
function paddedRange(low: number | null, high: number | null): [number, number] {
  const reach = Math.max(5, Math.abs(low ?? 0), Math.abs(high ?? 0)) * 1.1;
  return [-reach, reach];
}
