// The first minutes with the robot: drive it, or start a patrol, which turns before walls.
//
// A patrol is this page driving: it has this page's control, plays the gait by Start, and sets the turn as the slider
// does. Stop, the emergency stop, another's taking over, a lost link and any hold end it; so does steering.

import { api } from "../link/api";
import type { App } from "../app/app";
import { byId, h, setText } from "../basics/dom";
import { fixed } from "../basics/format";
import "../styles/panels/patrol.css";
import { inForce } from "./gaits";

const STEP_EVERY_MS = 1000;
const SEEN = "snakeslam.welcomed";

export function mountPatrol(app: App): void {
  const patrol = new Patrol(app);
  byId("viewer").closest(".view-stage")!.append(patrol.root);
  app.state.watch(() => patrol.sync());
  app.role.watch(() => patrol.sync());
  app.link.watch(() => patrol.sync());
  app.lease.current.watch(() => patrol.sync());
}

class Patrol {
  private timer = 0;
  /** The turn that was set last; null while no patrol goes. */
  private turn: number | null = null;
  /** The robot has said that it has this turn, and that it moves. */
  private settled = false;
  private moved = false;
  private welcomed = localStorage.getItem(SEEN) !== null;
  private readonly words = h("p", { id: "patrol-words", role: "status" });
  private readonly go = h("button", { class: "button", type: "button", id: "patrol-start", onclick: () => void this.start() }, "Patrol");
  private readonly halt = h("button", { class: "button", type: "button", id: "patrol-stop", onclick: () => void this.stop() }, "Stop the patrol");
  private readonly close = h("button", { class: "text-button", type: "button", id: "patrol-close", onclick: () => this.welcome() }, "Not now");
  private readonly title = h("h2", {}, "Drive me");
  readonly root = h("section", { class: "patrol", id: "patrol", "aria-label": "Patrol" }, this.title, this.words, h("div", { class: "patrol-actions" }, this.go, this.halt, this.close));

  constructor(private readonly app: App) {
    this.say("");
  }

  sync(): void {
    const state = this.app.state.get();
    const going = this.turn !== null;
    const reason = going ? this.over() : null;
    if (reason !== null) return this.end(reason);
    const offered = this.app.commandable && state?.moving === false && !state.estop.latched;
    if (state?.moving) this.welcome();
    this.root.hidden = !going && !offered;
    this.root.classList.toggle("card", !this.welcomed);
    this.title.hidden = this.close.hidden = this.welcomed;
    this.go.hidden = going;
    this.halt.hidden = !going;
  }

  /** Why a patrol that goes is over; null while it is not. */
  private over(): string | null {
    const state = this.app.state.get();
    if (this.app.link.get().phase !== "live" || !state) return "the link was lost";
    if (!this.app.lease.mine) return this.moved ? "this page has no control any more" : null;
    if (state.estop.latched) return "emergency stop";
    if (!state.moving) return this.moved ? (state.held_because ?? "the robot was stopped") : null;
    this.moved = true;
    // A state may be older than the turn that was set last.
    if (state.gait.turn === this.turn) this.settled = true;
    return this.settled && state.gait.turn !== this.turn ? "you steer" : null;
  }

  private async start(): Promise<void> {
    this.welcome();
    const begun = await this.app.command(async () => {
      await this.steer(0);
      await api.start();
      return true;
    });
    if (!begun) return this.end("");
    this.say("Patrol: straight on");
    this.sync();
    this.timer = window.setTimeout(() => void this.advance(), STEP_EVERY_MS);
  }

  private async stop(): Promise<void> {
    this.end("");
    await this.app.attempt(() => api.stop());
  }

  private async advance(): Promise<void> {
    if (this.turn === null) return;
    const turning = this.turn;
    const answer = await this.app.command(async () => {
      const found = await api.clearance(turning);
      if (found.turn !== null && found.turn !== turning && this.turn !== null) await this.steer(found.turn);
      return found;
    });
    if (this.turn === null) return;
    if (!answer) return void this.stop();
    if (answer.turn === null) {
      await this.stop();
      this.say(`Patrol ended: ${answer.reason ?? "it cannot go on"}. Drive back with S or the pad.`);
      return;
    }
    const ahead = answer.free_m?.[answer.directions_deg.indexOf(0)];
    const direction = answer.turn === 0 ? "straight on" : `turning ${answer.turn > 0 ? "left" : "right"}`;
    this.say(`Patrol: ${direction}, ${fixed(ahead, 1)} m free ahead`);
    this.timer = window.setTimeout(() => void this.advance(), STEP_EVERY_MS);
  }

  /** Set the turn of the gait that is offered first, one that moves forward and can be steered. */
  private async steer(turn: number): Promise<void> {
    this.settled = false;
    this.turn = turn;
    const entry = this.app.catalogue.get().find((gait) => gait.turns);
    if (entry) await api.setGait({ name: entry.name, ...inForce(entry, this.app.state.get()), turn });
  }

  private end(reason: string): void {
    window.clearTimeout(this.timer);
    this.turn = null;
    this.settled = this.moved = false;
    this.say(reason === "" ? "" : `Patrol ended: ${reason}.`);
    this.sync();
  }

  private say(words: string): void {
    setText(this.words, words !== "" || this.welcomed ? words : "Hold W A S D, the pad or a gamepad's stick to drive; releasing stops. Or start a patrol: it maps the surroundings by itself and turns before walls.");
    this.words.hidden = this.words.textContent === "";
  }

  private welcome(): void {
    if (this.welcomed) return;
    this.welcomed = true;
    localStorage.setItem(SEEN, "1");
    if (this.turn === null) this.say("");
    this.sync();
  }
}
