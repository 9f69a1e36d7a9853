// Which controller holds the head, with how long a neck, and where its line points.

import { ApiError, api } from "../link/api";
import type { App } from "../app/app";
import { byId, h, icon, setText } from "../basics/dom";
import "../styles/panels/headcontrol.css";
import type { HeadAnswer, HeadEntry, HeadRequest } from "../types";
import { Choice } from "./choice";
import { NumberForm } from "./numberform";

const STEP_DEG = 15;

export function mountHeadControl(app: App): void {
  const panel = new HeadControlPanel(app);
  app.state.watch(() => panel.sync());
  app.link.watch(() => panel.sync());
  app.role.watch(() => panel.sync());
  app.lease.current.watch(() => panel.sync());
  // Another server, or the same with other settings, may have other controllers.
  app.reloaded.on(() => panel.reload());
}

class HeadControlPanel {
  private answer: HeadAnswer | null = null;
  /** What the last answer was for: which controllers there are depends on it. */
  private answeredFor = "";
  private focused: string | null = null;
  private readonly choice = new Choice<HeadEntry["name"]>("head-controller", "Head controller", (controller) => this.send({ controller }));
  private readonly about = h("p", { class: "hint", id: "head-about", "aria-live": "polite" });
  private readonly missing = h("p", { class: "hint", id: "head-missing" });
  private readonly neck = new NumberForm(
    { id: "head-neck", label: "Neck", spoken: "Neck, yaw joints", unit: "joints", step: 1, button: "Set" },
    (neck_joints) => this.send({ neck_joints }),
  );
  private readonly turn = new NumberForm(
    { id: "head-turn", label: null, spoken: "Turn the heading by degrees, left is positive", unit: "\u00b0", step: 1, button: "Turn" },
    (turn_by_deg) => this.send({ turn_by_deg }),
  );
  private readonly left = this.stepButton("left", STEP_DEG);
  private readonly right = this.stepButton("right", -STEP_DEG);
  /** Why the heading cannot be turned now. */
  private readonly steering = h("p", { class: "hint", id: "head-steering" });

  constructor(private readonly app: App) {
    this.choice.onLook = (name) => {
      this.focused = name;
      this.describe();
    };
    const heading = { class: "steer", role: "group", "aria-label": "Turn the heading" };
    const parts = [
      h("header", { class: "head-control-head" }, h("h2", {}, "Head control"), this.neck.root),
      this.choice.root,
      this.about,
      this.missing,
      h("div", heading, this.left, this.turn.root, this.right),
      this.steering,
    ];
    byId("head").append(h("section", { class: "head-control", "aria-label": "Head control" }, ...parts));
  }

  reload(): void {
    this.answeredFor = "";
    this.sync();
  }

  sync(): void {
    const state = this.app.state.get();
    const control = state?.head_control ?? null;
    const gait = { ...state?.gait, drive: 0, turn: 0 };
    const key = JSON.stringify([state?.session, state?.source, state?.robot, gait, control]);
    if (state && this.app.link.get().phase === "live" && key !== this.answeredFor) void this.load(key);
    const ready = this.app.commandable && control !== null;
    this.choice.mark(control?.controller ?? null, ready);
    this.neck.follow(control?.neck_joints ?? null);
    this.neck.enable(ready);
    this.describe();
    this.showSteering(ready);
  }

  private async load(key: string): Promise<void> {
    this.answeredFor = key;
    let answer: HeadAnswer;
    try {
      answer = await api.head();
    } catch (error) {
      // Asked again with the next state; nobody waits for it, so only a lost sign-in is reported.
      this.answeredFor = "";
      if (error instanceof ApiError && error.status === 401) this.app.report(error);
      return;
    }
    if (key !== this.answeredFor) return;
    const first = this.answer === null;
    this.answer = answer;
    this.choice.set(answer.controllers);
    this.neck.limits(answer.neck_joints.min, answer.neck_joints.max);
    this.turn.limits(answer.turn_by_deg.min, answer.turn_by_deg.max);
    if (first) this.turn.preset(2 * STEP_DEG);
    const missing = answer.controllers.filter(({ available }) => !available).map(({ title }) => title);
    setText(this.missing, missing.length > 0 ? `Not available now: ${missing.join(", ")}. Choose one to see why.` : "");
    this.sync();
  }

  private entry(name: string | null | undefined): HeadEntry | undefined {
    return this.answer?.controllers.find((entry) => entry.name === name);
  }

  /** Describe the focused controller, else the present one, or why it is not available. */
  private describe(): void {
    const entry = this.entry(this.focused ?? this.app.state.get()?.head_control?.controller);
    const words = entry?.reason ? `${entry.title} cannot be chosen: ${entry.reason}.` : entry?.summary;
    setText(this.about, words ?? "");
  }

  private showSteering(ready: boolean): void {
    const steers = this.entry(this.app.state.get()?.head_control?.controller)?.steers === true;
    this.left.disabled = this.right.disabled = !ready || !steers;
    this.turn.enable(ready && steers);
    const by = this.answer?.controllers.filter((entry) => entry.steers).map(({ title }) => title) ?? [];
    const why = `To turn the heading by degrees, choose ${by.join(" or ")}.`;
    setText(this.steering, !ready || steers || by.length === 0 ? "" : why);
  }

  private stepButton(side: "left" | "right", turn_by_deg: number): HTMLButtonElement {
    const words = [icon(side), `${STEP_DEG}\u00b0`];
    const label = `${STEP_DEG}\u00b0 to the ${side}: turn the heading`;
    const onclick = () => this.send({ turn_by_deg });
    const attributes = { class: "button", type: "button", id: `head-${side}`, "aria-label": label, title: label, onclick };
    return h("button", attributes, ...(side === "left" ? words : words.reverse()));
  }

  private send(request: HeadRequest): void {
    void this.app.command(() => api.setHead(request)).then(() => this.sync());
  }
}
