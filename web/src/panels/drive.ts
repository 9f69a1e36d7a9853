// Who has control, the pad to drive with, start, stop and turn.

import { api } from "../link/api";
import type { App } from "../app/app";
import { byId, h, icon, setText } from "../basics/dom";
import { fixed } from "../basics/format";
import type { DeadmanInput } from "../app/deadman-input";
import type { Teleop } from "../app/teleop";
import "../styles/panels/drive.css";
import { makeControl } from "./control";
import { inForce } from "./gaits";
import { makePad } from "./pad";

const SEND_EVERY_MS = 150;

export function mountDrive(app: App, deadman: DeadmanInput, teleop: Teleop): void {
  const start = h("button", { class: "button start", type: "button", id: "start" }, icon("play"), "Start");
  const stop = h("button", { class: "button stop", type: "button", id: "stop" }, icon("square"), "Stop");
  const turn = h("input", { type: "range", id: "turn", min: -1, max: 1, step: 0.05, value: 0, class: "centred" });
  const reading = h("output", { class: "num", for: "turn" }, "straight");
  const straight = h("button", { class: "text-button", type: "button", id: "straight" }, "Straight");
  const why = h("p", { class: "hint", id: "drive-note" });
  byId("drive").append(
    ...makeControl(app),
    makePad(app, deadman, teleop),
    h("div", { class: "turn" }, h("label", { for: "turn" }, "Turn"), reading, straight, turn, ends()),
    why,
    h("div", { class: "drive-actions" }, start, stop),
  );
  start.addEventListener("click", () => void app.command(() => api.start()));
  stop.addEventListener("click", () => void app.attempt(() => api.stop()));

  const sender = new TurnSender(app);
  const show = (value: number) => {
    // The slider runs left to right on the screen, while a positive turn is to the left.
    turn.value = String(-value);
    setText(reading, turnWords(value));
  };
  const edit = (value: number) => {
    show(value);
    sender.send(value);
  };
  turn.addEventListener("input", () => edit(-Number(turn.value)));
  straight.addEventListener("click", () => edit(0));

  const sync = () => {
    const state = app.state.get();
    const ready = app.commandable;
    start.disabled = !ready || state?.estop.latched === true || state?.moving === true;
    // Stopping needs no control.
    const stoppable = app.link.get().phase === "live" && state?.source.kind === "sim" && app.role.get() === "operator";
    stop.disabled = !stoppable || state?.moving !== true;
    turn.disabled = straight.disabled = !ready || !canTurn(app);
    if (state && !sender.busy && document.activeElement !== turn) show(state.gait.turn);
    setText(why, note(app));
  };
  app.state.watch(sync);
  app.catalogue.watch(sync);
  app.link.watch(sync);
  app.role.watch(sync);
  app.lease.current.watch(sync);
}

function ends(): HTMLElement {
  return h("span", { class: "slider-ends muted", "aria-hidden": "true" }, h("span", {}, "left"), h("span", {}, "right"));
}

function turnWords(turn: number): string {
  if (Math.abs(turn) < 0.025) return "straight";
  return `${fixed(100 * Math.abs(turn), 0)} % ${turn > 0 ? "left" : "right"}`;
}

function note(app: App): string {
  const state = app.state.get();
  if (!state || app.link.get().phase !== "live") return "";
  if (state.source.kind === "recording") return "A recording plays: there is no robot to drive. Choose the simulator above.";
  if (state.estop.latched) return "Reset the emergency stop first.";
  if (state.held_because !== null) return `The robot is held: ${state.held_because}. Start it again, or drive.`;
  return canTurn(app) ? "" : "This gait cannot turn.";
}

function canTurn(app: App): boolean {
  const name = app.state.get()?.gait.name;
  return app.catalogue.get().find((gait) => gait.name === name)?.turns !== false;
}

/** Sends the newest turn at a bounded rate while the slider moves. */
class TurnSender {
  busy = false;
  private waiting: number | null = null;

  constructor(private readonly app: App) {}

  send(turn: number): void {
    this.waiting = turn;
    if (!this.busy) void this.drain();
  }

  private async drain(): Promise<void> {
    this.busy = true;
    while (this.waiting !== null) {
      const turn = this.waiting;
      this.waiting = null;
      await this.app.command(async () => this.steer(turn));
      await new Promise((resolve) => setTimeout(resolve, SEND_EVERY_MS));
    }
    this.busy = false;
  }

  private async steer(turn: number): Promise<void> {
    const state = this.app.state.get();
    const entry = this.app.catalogue.get().find(({ name }) => name === state?.gait.name);
    if (entry) await api.setGait({ name: entry.name, ...inForce(entry, state), turn });
  }
}
