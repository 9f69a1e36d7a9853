// Who has control, and the explicit act of taking it over.

import type { App } from "../app/app";
import { h, setText } from "../basics/dom";
import { LONGEST_NAME } from "../basics/operator-name";
import "../styles/panels/control.css";

/** The card with who has control, and the line with this operator's name. */
export function makeControl(app: App): HTMLElement[] {
  const words = h("span", { id: "control-holder" });
  const name = makeName(app);
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
    name.show(viewer, !mine);
    take.disabled = give.disabled = !live;
  };
  app.state.watch(show);
  app.role.watch(show);
  app.lease.current.watch(show);
  app.link.watch(show);
  return [box, name.root];
}

/** The operator's name as others will see it, with a field to change it before control is taken. */
function makeName(app: App): { root: HTMLElement; show: (viewer: boolean, editable: boolean) => void } {
  const now = h("span", { class: "muted", id: "operator-name-now" });
  const field = h("input", { type: "text", id: "operator-name", maxlength: LONGEST_NAME, autocomplete: "nickname", spellcheck: "false" });
  const change = h("button", { class: "text-button", type: "button", id: "operator-name-change" }, "Change name");
  const keep = h("button", { class: "button", type: "submit" }, "Keep");
  const form = h("form", { class: "name-form", hidden: true }, h("label", { for: "operator-name" }, "Your name"), field, keep);
  const line = h("div", { class: "name-line" }, now, change);
  const root = h("div", { class: "name" }, line, form);
  const edit = (editing: boolean) => {
    form.hidden = !editing;
    line.hidden = editing;
    setText(now, `You are \u201c${app.lease.name.text}\u201d.`);
  };
  change.addEventListener("click", () => {
    edit(true);
    field.value = app.lease.name.text;
    field.select();
    field.focus();
  });
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    app.lease.name.set(field.value);
    edit(false);
    change.focus();
  });
  edit(false);
  return {
    root,
    // The line stays where it is while control comes and goes: the pad below must not move.
    show: (viewer, editable) => {
      root.hidden = viewer;
      change.hidden = !editable;
      if (!editable) edit(false);
    },
  };
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

/** In a few words, for the top bar. */
export function controlChip(app: App): string {
  if (app.lease.mine) return "You";
  return app.state.get()?.control.holder ?? "Nobody";
}
