// The timeline: what happened, newest first, and a strip of the estimator's health.

import type { App } from "../app/app";
import { byId, cssColour, fitCanvas, h, sizeOf } from "../basics/dom";
import { capitalised, clock } from "../basics/format";
import { GAP_S } from "../app/history";
import "../styles/panels/events.css";
import type { TimelineEvent, Verdict } from "../types";

const KEPT = 200;
const STRIP_S = 120;

interface Mark {
  t_s: number;
  verdict: Verdict;
}

export function mountEvents(app: App): void {
  const list = h("ol", { class: "event-list", id: "event-list", tabindex: "0", "aria-label": "Events, newest first" });
  const empty = h("li", { class: "muted event-empty" }, "Nothing has happened yet");
  const strip = h("canvas", { class: "health-strip", role: "img", "aria-label": "Health over the last two minutes" });
  list.append(empty);
  byId("events").append(
    h("header", { class: "panel-head" }, h("h2", {}, "Timeline"), h("span", { class: "muted" }, "health, last 2 min")),
    strip,
    list,
  );
  const marks: Mark[] = [];
  const events: TimelineEvent[] = [];
  app.opened.on(() => {
    events.length = 0;
    list.replaceChildren(empty);
  });
  app.timeline.on((event) => {
    empty.remove();
    events.push(event);
    list.prepend(item(event));
    while (list.childElementCount > KEPT) list.lastElementChild?.remove();
    if (events.length > KEPT) events.shift();
  });
  app.tick.on(({ t_s, health }) => {
    const last = marks[marks.length - 1];
    if (last && t_s < last.t_s) {
      marks.length = 0;
      events.length = 0;
    }
    if (!last || t_s - last.t_s >= 0.25 || last.verdict !== health.verdict) marks.push({ t_s, verdict: health.verdict });
    while ((marks[0]?.t_s ?? t_s) < t_s - STRIP_S) marks.shift();
  });
  app.redraw.every(500, () => drawStrip(strip, marks, events));
}

function item(event: TimelineEvent): HTMLElement {
  const words = { info: "", warning: "Warning: ", error: "Error: " };
  return h(
    "li",
    { "data-level": event.level },
    h("time", { class: "num" }, clock(event.t_s)),
    h("span", {}, h("span", { class: "visually-hidden" }, words[event.level]), capitalised(event.text)),
  );
}

function drawStrip(canvas: HTMLCanvasElement, marks: Mark[], events: TimelineEvent[]): void {
  if (sizeOf(canvas).width === 0) return;
  fitCanvas(canvas);
  const context = canvas.getContext("2d");
  const end = marks[marks.length - 1]?.t_s;
  if (!context || end === undefined) return;
  const { width, height } = canvas;
  const x = (t_s: number) => width * (1 - (end - t_s) / STRIP_S);
  context.clearRect(0, 0, width, height);
  marks.forEach((mark, index) => {
    // A mark is renewed several times a second: without the next, nothing is known of the time after it.
    const until = Math.min(marks[index + 1]?.t_s ?? end, mark.t_s + GAP_S);
    context.fillStyle = cssColour(`--verdict-${mark.verdict}`);
    // Worse is lower as well as another colour.
    const top = { good: 0, initialising: 0.25, degraded: 0.35, blind: 0.6, lost: 0.75 }[mark.verdict] * height;
    context.fillRect(x(mark.t_s), top, Math.max(1, x(until) - x(mark.t_s) + 0.5), height - top);
  });
  context.fillStyle = cssColour("--text");
  for (const event of events) {
    if (event.t_s > end || event.t_s < end - STRIP_S) continue;
    context.fillRect(x(event.t_s) - 1, 0, 2, height);
  }
}
