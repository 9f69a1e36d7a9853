// How a recording plays: pause, single frames, a slider to seek with, the speed. Shown only while one is open.

import { api } from "../link/api";
import type { App } from "../app/app";
import { byId, h, icon, setText } from "../basics/dom";
import { clock } from "../basics/format";
import "../styles/panels/player.css";
import type { Playback, PlaybackRequest } from "../types";

const SPEEDS = [0.25, 0.5, 1, 2, 4, 8];
const STEP_S = 0.01;

export function mountPlayer(app: App): void {
  const player = new Player(app);
  app.state.watch((state) => player.show(state?.source.kind === "recording" ? state.playback : null));
  app.tick.on((tick) => player.show(tick.playback));
  app.role.watch(() => player.allow());
  app.link.watch(() => player.allow());
}

class Player {
  private readonly root = byId("player");
  private readonly play = h("button", { class: "toggle player-button", type: "button", id: "player-play" });
  private readonly back = this.stepper(-1, "stepBack", "One frame back");
  private readonly ahead = this.stepper(1, "stepAhead", "One frame ahead");
  private readonly slider = h("input", { type: "range", id: "player-position", "aria-label": "Position", min: 0, max: 0, step: STEP_S });
  private readonly time = h("output", { class: "num player-time", for: "player-position" });
  private readonly speed = h(
    "select",
    { id: "player-speed", "aria-label": "Speed" },
    ...SPEEDS.map((speed) => h("option", { value: speed }, `${speed}\u00d7`)),
  );
  private playback: Playback | null = null;
  private dragging = false;
  private busy = false;
  private next: PlaybackRequest | null = null;

  constructor(private readonly app: App) {
    this.root.append(this.play, this.back, this.ahead, this.slider, this.time, this.speed);
    this.play.addEventListener("click", () => this.send({ paused: !this.atRest }));
    this.speed.addEventListener("change", () => this.send({ speed: Number(this.speed.value) }));
    this.slider.addEventListener("input", () => {
      this.dragging = true;
      this.send({ position_s: this.slider.valueAsNumber });
    });
    for (const end of ["change", "pointerup", "pointercancel", "blur"]) this.slider.addEventListener(end, () => (this.dragging = false));
  }

  show(playback: Playback | null): void {
    this.root.hidden = playback === null;
    if (playback === null) return;
    this.playback = playback;
    const { duration_s, position_s, computed_s, seeking, speed } = playback;
    this.slider.max = String(duration_s);
    if (!this.dragging && !this.busy) this.slider.value = String(position_s);
    const part = (seconds: number) => `${((100 * seconds) / Math.max(duration_s, STEP_S)).toFixed(1)}%`;
    this.slider.style.setProperty("--fill", part(this.slider.valueAsNumber));
    this.slider.style.setProperty("--computed", part(computed_s));
    this.slider.setAttribute("aria-valuetext", `${clock(position_s)} of ${clock(duration_s)}`);
    setText(this.time, `${clock(position_s)} / ${clock(duration_s)}${seeking ? ", computing" : ""}`);
    if (document.activeElement !== this.speed) this.speed.value = String(speed);
    const words = this.atRest ? "Play" : "Pause";
    if (this.play.getAttribute("aria-label") !== words) {
      this.play.setAttribute("aria-label", words);
      this.play.title = words;
      this.play.replaceChildren(icon(this.atRest ? "play" : "pause"));
    }
    this.allow();
  }

  allow(): void {
    const allowed = this.app.role.get() === "operator" && this.app.link.get().phase === "live";
    for (const part of [this.play, this.back, this.ahead, this.slider, this.speed]) part.disabled = !allowed;
  }

  private get atRest(): boolean {
    return this.playback === null || this.playback.paused || this.playback.at_end;
  }

  private stepper(step: number, name: "stepBack" | "stepAhead", words: string): HTMLButtonElement {
    const button = h("button", { class: "toggle player-button", type: "button", "aria-label": words, title: words }, icon(name));
    button.addEventListener("click", () => this.send({ step }));
    return button;
  }

  /** Send a request; while one is pending the newest position waits, so that a drag does not queue up. */
  private send(request: PlaybackRequest): void {
    if (this.busy) {
      this.next = { ...this.next, ...request };
      return;
    }
    this.busy = true;
    void this.app.command(() => api.playback(request)).then(() => {
      this.busy = false;
      const next = this.next;
      this.next = null;
      if (next) this.send(next);
    });
  }
}
