// Joint curves: the chosen joints commanded (dashed) and measured (solid), and an overview of all of them.

import uPlot from "uplot";
import "uplot/dist/uPlot.min.css";
import type { App } from "../app/app";
import { byId, cssColour, h, icon, setText, sizeOf } from "../basics/dom";
import { JointHistory } from "../app/history";
import "../styles/panels/joints.css";
import { Heatmap } from "./heatmap";

const WINDOW_S = 20;
const REDRAW_MS = 200;
const MOST_CHOSEN = 6;
const SPANS_S = [20, 10, 5, 2];
const LEAST_DRAG_PX = 8;

interface Zoom {
  x: [number, number];
  y: [number, number];
}

export function mountJoints(app: App): void {
  const panel = new JointsPanel();
  app.tick.on((tick) => panel.history.push(tick));
  app.cleared.on(() => panel.history.clear());
  app.theme.on(() => panel.rebuild());
  app.redraw.every(REDRAW_MS, () => panel.refresh());
}

class JointsPanel {
  readonly history = new JointHistory(WINDOW_S);
  private chosen: number[] = [];
  private paused = false;
  private all = false;
  private span_s = WINDOW_S;
  private zoom: Zoom | null = null;
  private plot: uPlot | null = null;
  private joints = 0;
  private readonly holder = h("div", { class: "plot", id: "joint-plot" });
  private readonly chips = h("div", { class: "joint-chips", role: "group", "aria-label": "Chosen joints" });
  private readonly grid = h("div", { class: "joint-grid" });
  private readonly scale = h("span", { class: "muted num" });
  private readonly heatmap = new Heatmap((joint) => this.toggle(joint));
  private readonly pause = h("button", { class: "toggle", type: "button", "aria-pressed": "false", id: "joints-pause" }, "Pause");

  private readonly every = h("button", { class: "toggle", type: "button", "aria-pressed": "false", id: "joints-all" }, "All");
  private readonly whole = h("button", { class: "toggle", type: "button", id: "joints-whole", hidden: true }, "Zoom out");
  private readonly span = h(
    "select",
    { id: "joints-span", "aria-label": "Time shown" },
    ...SPANS_S.map((seconds) => h("option", { value: seconds }, `${seconds} s`)),
  );

  constructor() {
    this.pause.addEventListener("click", () => this.setPaused(!this.paused));
    this.every.title = "Every joint as measured";
    this.every.addEventListener("click", () => {
      this.all = !this.all;
      this.every.setAttribute("aria-pressed", String(this.all));
      this.rebuild();
    });
    this.whole.addEventListener("click", () => this.zoomTo(null));
    this.span.addEventListener("change", () => {
      this.span_s = Number(this.span.value);
      this.zoomTo(null);
    });
    this.holder.title = "Drag to zoom";
    byId("joints").append(
      h(
        "div",
        { class: "plot-bar" },
        this.chips,
        h("span", { class: "line-key" }, h("i", { class: "solid" }), "meas. ", h("i", { class: "dashed" }), "cmd."),
        this.span,
        this.whole,
        this.every,
        h("details", { class: "picker" }, h("summary", {}, "Pick", icon("chevron")), this.grid),
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

  private setPaused(paused: boolean): void {
    this.paused = paused;
    this.pause.setAttribute("aria-pressed", String(paused));
    if (!paused) this.zoomTo(null);
  }

  /** Show a part; time is frozen meanwhile, or it would move out of view. */
  private zoomTo(zoom: Zoom | null): void {
    this.zoom = zoom;
    this.whole.hidden = zoom === null;
    if (zoom && !this.paused) this.setPaused(true);
    this.plot?.setData(this.data());
  }

  private onSelect(plot: uPlot): void {
    const { left, top, width, height } = plot.select;
    if (width < LEAST_DRAG_PX && height < LEAST_DRAG_PX) return;
    const x: [number, number] = [plot.posToVal(left, "x"), plot.posToVal(left + width, "x")];
    const y: [number, number] = [plot.posToVal(top + height, "y"), plot.posToVal(top, "y")];
    plot.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
    this.zoomTo({ x, y });
  }

  refresh(): void {
    if (this.history.joints !== this.joints) this.adopt(this.history.joints);
    if (this.paused || sizeOf(this.holder).width === 0 || this.history.samples.length === 0) return;
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
    const label = `J${joint} ${kind}: remove from the plot`;
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
    const columns: (number | null)[][] = [samples.map((sample) => sample.t_s - end_s)];
    if (this.all) {
      for (let joint = 0; joint < this.joints; joint++) columns.push(samples.map((sample) => known(sample.measured[joint])));
      return columns as uPlot.AlignedData;
    }
    for (const joint of this.chosen) {
      columns.push(samples.map((sample) => known(sample.target[joint - 1])));
      columns.push(samples.map((sample) => known(sample.measured[joint - 1])));
    }
    return columns as uPlot.AlignedData;
  }

  private options(width: number, height: number): uPlot.Options {
    const axis = { stroke: cssColour("--muted"), grid: { stroke: cssColour("--grid"), width: 1 }, ticks: { show: false } };
    const font = "11px system-ui, sans-serif";
    const series: uPlot.Series[] = [{}];
    const line = { points: { show: false }, spanGaps: false };
    // From tail to head through the colours.
    const hue = (joint: number) => `hsl(${Math.round((300 * joint) / Math.max(1, this.joints - 1))} 65% 50%)`;
    for (let joint = 0; this.all && joint < this.joints; joint++) series.push({ stroke: hue(joint), width: 1.2, ...line });
    if (!this.all) this.chosen.forEach((_, index) => {
      const stroke = cssColour(`--series-${index}`);
      series.push({ stroke, width: 1.2, dash: [5, 4], ...line });
      series.push({ stroke, width: 2, ...line });
    });
    return {
      width,
      height,
      series,
      legend: { show: false },
      cursor: { points: { show: false }, x: false, y: false, drag: { x: true, y: true, uni: 20, setScale: false, dist: LEAST_DRAG_PX } },
      hooks: { setSelect: [(plot) => this.onSelect(plot)] },
      padding: [8, 14, 0, 0],
      scales: { x: { time: false, range: () => this.zoom?.x ?? [-this.span_s, 0] }, y: { range: (_, low, high) => this.zoom?.y ?? paddedRange(low, high) } },
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

/** An angle to draw; null, which is a gap in the line, where it is not known. */
function known(angle: number | undefined): number | null {
  return angle === undefined || Number.isNaN(angle) ? null : angle;
}

/** At least +-5 deg, so that a stationary robot shows flat lines and not magnified noise. */
function paddedRange(low: number | null, high: number | null): [number, number] {
  const reach = Math.max(5, Math.abs(low ?? 0), Math.abs(high ?? 0)) * 1.1;
  return [-reach, reach];
}
