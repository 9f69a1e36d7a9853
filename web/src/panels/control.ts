// Who has control, and the explicit act of taking it over.

import type { App } from "../app";
import { h, setText } from "../dom";

export function makeControl(app: App): HTMLElement {
  const words = h("span", { id: "control-holder" });
  const take = h("button", { class: "button", type: "button", id: "control-take" }, "Take control");
  const give = h("button", { class: "button", type: "button", id: "control-release" }, "Give back");
  take.addEventListener("click", () => void app.attempt(() => app.lease.take(app.state.get()?.control.id != null)));
  give.addEventListener("click", () => void app.attempt(() => app.lease.release()));
  const box = h("div", { class: "control-card", role: "group", "aria-label": "Control of the robot" }, words, take, give);
  const show = () => {
    const state = app.state.get();
    const { mine } = app.lease;
    const viewer = app.role.get() === "viewer";
    const held = state?.control.id != null;
    const live = app.link.get().phase === "live";
    box.dataset["held"] = mine ? "mine" : held ? "other" : "free";
    setText(words, viewer && !mine ? watching(state?.control.holder) : controlWords(app));
    setText(take, held ? "Take over" : "Take control");
    take.hidden = mine || viewer;
    give.hidden = !mine;
    take.disabled = give.disabled = !live;
  };
  app.state.watch(show);
  app.role.watch(show);
  app.lease.current.watch(show);
  app.link.watch(show);
  return box;
}

function watching(holder: string | null | undefined): string {
  return holder ? `You may only watch. ${holder} has control.` : "You may only watch.";
}

/** In a few words, for the card. */
function controlWords(app: App): string {
  if (app.lease.mine) return "You have control.";
  const holder = app.state.get()?.control.holder;
  return holder ? `${holder} has control.` : "Nobody has control.";
}

/** In one word or two, for the top bar. */
export function controlChip(app: App): string {
  if (app.lease.mine) return "You";
  return app.state.get()?.control.holder ?? "Nobody";
}
