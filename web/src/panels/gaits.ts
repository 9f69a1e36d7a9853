// The gait cards, each with its gait's own motion drawn small.

import type { App } from "../app/app";
import { byId, h } from "../basics/dom";
import { GaitDrawing } from "../drawing/gait-drawing";
import { ApiError, api } from "../link/api";
import "../styles/panels/gaits.css";
import type { GaitEntry, ParameterValues, RobotState } from "../types";

const REDRAW_MS = 100;
const RETRY_MS = 5000;
const STILL_AT_S = 0.5;

export const defaults = (entry: GaitEntry): ParameterValues =>
  Object.fromEntries(entry.parameters.map((parameter) => [parameter.key, parameter.default]));

/** The parameters in force: the gait's own default wherever the state has none. */
export function inForce(entry: GaitEntry, state: RobotState | null): ParameterValues {
  const gait = state?.gait.name === entry.name ? state.gait : null;
  return Object.fromEntries(entry.parameters.map(({ key, default: value }) => [key, gait?.[key] ?? value]));
}

export function mountGaits(app: App): void {
  const list = h("div", { class: "gait-cards", role: "group", "aria-label": "Gait" });
  byId("gaits").append(h("h2", { class: "visually-hidden" }, "Gait"), list);
  let cards: Card[] = [];
  const sync = () => {
    for (const card of cards) card.sync();
  };
  app.catalogue.watch((catalogue) => {
    cards = catalogue.map((entry) => new Card(app, entry));
    list.replaceChildren(...cards.map((card) => card.button));
    sync();
  });
  app.state.watch(sync);
  app.link.watch(sync);
  app.role.watch(sync);
  app.lease.current.watch(sync);
  // At a calm rate while the page is seen, and without motion for those who asked for less of it.
  const still = matchMedia("(prefers-reduced-motion: reduce)");
  app.redraw.every(REDRAW_MS, () => {
    const seconds = still.matches ? STILL_AT_S : performance.now() / 1000;
    for (const card of cards) card.draw(seconds);
  });
}

class Card {
  readonly button: HTMLButtonElement;
  private readonly drawing = new GaitDrawing();
  /** The robot and parameters for which the drawing is, or was last requested. */
  private drawnFor = "";
  private retryAtMs = 0;

  constructor(
    private readonly app: App,
    private readonly entry: GaitEntry,
  ) {
    const choose = () => void app.command(() => api.setGait({ name: entry.name, ...defaults(entry), turn: app.state.get()?.gait.turn ?? 0 }));
    const attributes = { class: "gait-card", type: "button", "data-gait": entry.name, title: entry.summary, onclick: choose } as const;
    this.button = h("button", attributes, this.drawing.canvas, h("span", { class: "gait-title" }, entry.title));
  }

  sync(): void {
    const state = this.app.state.get();
    this.button.setAttribute("aria-pressed", String(state?.gait.name === this.entry.name));
    this.button.disabled = !this.app.commandable;
    const values = inForce(this.entry, state);
    const key = JSON.stringify([state?.robot, values]);
    if (state && this.app.link.get().phase === "live" && key !== this.drawnFor && performance.now() > this.retryAtMs) void this.load(key, values);
  }

  draw(seconds: number): void {
    this.drawing.draw(seconds, this.button.ariaPressed === "true");
  }

  private async load(key: string, values: ParameterValues): Promise<void> {
    this.drawnFor = key;
    try {
      const { drawing } = await api.previewGait(this.entry.name, values);
      if (key === this.drawnFor) this.drawing.show(drawing, values.period_s ?? 1);
    } catch (error) {
      // Requested again with a later state; the card works without its drawing, so only a lost sign-in is reported.
      this.drawnFor = "";
      this.retryAtMs = performance.now() + RETRY_MS;
      if (error instanceof ApiError && error.status === 401) this.app.report(error);
    }
  }
}
