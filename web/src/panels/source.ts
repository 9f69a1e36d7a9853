// What is shown: the simulator with its main settings, or a recording.

import { ApiError, api } from "../link/api";
import type { App } from "../app/app";
import { byId, h, icon, setText } from "../basics/dom";
import { errorLine } from "../link/failure";
import { fixed } from "../basics/format";
import "../styles/panels/source.css";
import type { Mode, Overrides, Recording, RobotState } from "../types";
import { openDialog, prepareDialog } from "./dialog";

/** Every value that the server allows, with its label. */
type Choices<Value extends string> = Record<Value, string>;
type Setting<Key extends keyof Overrides> = NonNullable<Overrides[Key]>;

const WORLDS: Choices<Setting<"sim.world">> = { corridor: "Corridor", office: "Office", rubble: "Rubble", blank: "Blank (little texture)" };
const ROBOTS: Choices<Setting<"robot.model">> = { sim35: "35 joints (sim35)", orthogonal24: "24 joints (orthogonal24)" };
const MODES: Choices<Mode> = {
  fused: "Visual-inertial + gait",
  vio: "Visual-inertial",
  planar: "Planar (the paper's)",
  visual: "Visual (camera only)",
  gait: "Gait only",
};
const KINDS: Record<string, string> = { euroc: "EuRoC", tum: "TUM RGB-D", tum_rgbd: "TUM RGB-D" };

interface Select<Value extends string> extends HTMLSelectElement {
  value: Value | "";
}

/** A list of `choices` after `first`, which stands for none of them. */
export function select<Value extends string>(id: string, choices: Choices<Value>, first: string): Select<Value> {
  const options = Object.entries<string>(choices).map(([value, text]) => h("option", { value }, text));
  return h("select", { id }, h("option", { value: "" }, first), ...options) as Select<Value>;
}

export function labelled(text: string, control: HTMLElement): HTMLElement {
  return h("div", { class: "labelled" }, h("label", { for: control.id }, text), control);
}

export function mountSource(app: App): void {
  const button = byId("source") as HTMLButtonElement;
  const name = h("span", { class: "source-name" });
  const kind = h("span", { class: "source-kind" });
  const purpose = h("span", { class: "visually-hidden" }, ": choose what to show");
  button.append(h("span", { class: "source-words" }, kind, name), purpose, icon("chevron"));
  const dialog = new SourceDialog(app);
  button.addEventListener("click", () => dialog.open());
  app.state.watch((state) => {
    setText(kind, state?.source.kind === "recording" ? "Recording" : "Simulator");
    setText(name, state ? sourceName(state) : "\u2013");
  });
}

function sourceName({ source, robot }: RobotState): string {
  if (source.kind === "recording") return source.name;
  return source.name === "simulator" ? robot.model : `${source.name}, ${robot.model}`;
}

class SourceDialog {
  private readonly dialog = byId("source-dialog") as HTMLDialogElement;
  private readonly world = select("sim-world", WORLDS, "As configured");
  private readonly robot = select("sim-robot", ROBOTS, "As configured");
  private readonly simMode = select("sim-mode", MODES, "As configured");
  private readonly friction = h("input", { type: "number", id: "sim-friction", min: 1, max: 20, step: 0.5, placeholder: "As configured" });
  private readonly list = h("ul", { class: "recordings" });

  constructor(private readonly app: App) {
    app.reloaded.on(() => this.dialog.open && void this.load());
    const form = h(
      "form",
      { class: "sim-form" },
      labelled("World", this.world),
      labelled("Robot", this.robot),
      labelled("Estimator", this.simMode),
      labelled("Friction ratio", this.friction),
      h("button", { class: "button primary", type: "submit", id: "sim-start" }, "Start the simulator"),
    );
    form.addEventListener("submit", (event) => {
      event.preventDefault();
      this.choose(() => api.startSim(this.overrides()));
    });
    prepareDialog(
      this.dialog,
      "What to show",
      h("section", {}, h("h3", {}, icon("cube"), "Simulator"), form),
      h("section", {}, h("h3", {}, icon("film"), "Recordings"), this.list),
    );
  }

  open(): void {
    openDialog(this.dialog);
    void this.load();
  }

  private overrides(): Overrides {
    const chosen: Overrides = {};
    if (this.world.value) chosen["sim.world"] = this.world.value;
    if (this.robot.value) chosen["robot.model"] = this.robot.value;
    if (this.simMode.value) chosen["estimator.mode"] = this.simMode.value;
    if (this.friction.value) chosen["sim.friction_ratio"] = Number(this.friction.value);
    return chosen;
  }

  private choose(action: () => Promise<unknown>): void {
    this.dialog.close();
    void this.app.command(action);
  }

  private async load(): Promise<void> {
    let recordings: Recording[];
    try {
      recordings = await api.recordings();
    } catch (error) {
      if (error instanceof ApiError && error.status === 401) return this.app.report(error);
      return this.list.replaceChildren(h("li", { class: "field-error", role: "alert" }, errorLine(error)));
    }
    if (recordings.length > 0) this.list.replaceChildren(...recordings.map((recording) => this.row(recording)));
    else this.list.replaceChildren(h("li", { class: "muted" }, "None found. Start the server with --recordings DIR."));
  }

  private row(recording: Recording): HTMLElement {
    const mode = select(`mode-${recording.id}`, MODES, "What its sensors allow");
    mode.setAttribute("aria-label", `Estimator for ${recording.name}`);
    const play = h(
      "button",
      {
        class: "button",
        type: "button",
        "aria-label": `Play ${recording.name}`,
        onclick: () => this.choose(() => api.play(recording.id, mode.value || null)),
      },
      icon("play"),
      "Play",
    );
    return h(
      "li",
      { "data-recording": recording.name },
      h("div", {}, h("strong", {}, recording.name), h("span", { class: "muted" }, facts(recording))),
      mode,
      play,
    );
  }
}

function facts(recording: Recording): string {
  const { kind, frames, duration_s } = recording;
  const parts = [KINDS[kind] ?? kind];
  if (frames !== null) parts.push(`${frames} frames`);
  if (duration_s !== null) parts.push(`${fixed(duration_s, 1)} s`);
  return [...parts, ...origin(recording)].join(", ");
}

/** Gait, world and seed of a run, and when it was in this browser's time; what is unknown is left out. */
export function origin({ gait, world, seed, when }: Pick<Recording, "gait" | "world" | "seed" | "when">): string[] {
  const parts = [gait?.replace("_", " "), world, seed === null ? null : `seed ${seed}`];
  if (when !== null) parts.push(new Date(when).toLocaleString([], { dateStyle: "medium", timeStyle: "short" }));
  return parts.filter((part): part is string => typeof part === "string");
}
