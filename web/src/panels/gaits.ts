// The gait cards, each with its gait's own motion drawn small.

import { api } from "../api";
import type { App } from "../app";
import { byId, h } from "../dom";
import { GaitDrawing } from "../drawing";
import type { GaitEntry, ParameterValues, RobotState } from "../types";

const FRAME_MS = 100;

interface Card {
  entry: GaitEntry;
  button: HTMLButtonElement;
  drawing: GaitDrawing;
}

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
  let joints = 24;
  const build = () => {
    joints = app.state.get()?.robot.joints || joints;
    cards = app.catalogue.get().map((entry) => makeCard(app, entry, joints));
    list.replaceChildren(...cards.map((card) => card.button));
    mark();
  };
  const mark = () => {
    const state = app.state.get();
    for (const { entry, button, drawing } of cards) {
      button.setAttribute("aria-pressed", String(state?.gait.name === entry.name));
      button.disabled = !app.commandable;
      drawing.setValues(inForce(entry, state));
    }
  };
  app.catalogue.watch(build);
  app.state.watch((state) => (state && state.robot.joints > 0 && state.robot.joints !== joints ? build() : mark()));
  app.link.watch(mark);
  app.role.watch(mark);
  app.lease.current.watch(mark);
  animate(app, () => cards.map((card) => card.drawing), (index) => cards[index]?.button.ariaPressed === "true");
}

function makeCard(app: App, entry: GaitEntry, joints: number): Card {
  const drawing = new GaitDrawing(entry.name, defaults(entry), joints);
  const turn = () => app.state.get()?.gait.turn ?? 0;
  const choose = () => void app.command(() => api.setGait({ name: entry.name, ...defaults(entry), turn: turn() }));
  const button = h(
    "button",
    { class: "gait-card", type: "button", "data-gait": entry.name, title: entry.summary, onclick: choose },
    drawing.canvas,
    h("span", { class: "gait-title" }, entry.title),
  );
  return { entry, button, drawing };
}

/** Redraw at a calm rate while the page is seen; a still picture for those who asked for less motion. */
function animate(app: App, drawings: () => GaitDrawing[], active: (index: number) => boolean): void {
  const still = matchMedia("(prefers-reduced-motion: reduce)");
  app.redraw.every(FRAME_MS, () => {
    const seconds = still.matches ? 0.5 : performance.now() / 1000;
    drawings().forEach((drawing, index) => drawing.draw(seconds, active(index)));
  });
}
