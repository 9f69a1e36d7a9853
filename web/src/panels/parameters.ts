// The chosen gait's parameters, with units and limits; nothing changes until Apply.

import { api } from "../link/api";
import type { App } from "../app/app";
import { byId, h, icon, setText } from "../basics/dom";
import { stepDecimals, unitSign } from "../basics/format";
import "../styles/panels/parameters.css";
import type { GaitEntry, GaitParameter, ParameterKey, ParameterValues } from "../types";
import { defaults, inForce } from "./gaits";
import { PresetPicker } from "./presets";

/** The fields are still being edited until then. */
const PREVIEW_AFTER_MS = 200;

export function mountParameters(app: App): void {
  const panel = new ParametersPanel(app);
  app.catalogue.watch(() => panel.sync());
  app.state.watch(() => panel.sync());
  app.link.watch(() => panel.sync());
  app.role.watch(() => panel.sync());
  app.lease.current.watch(() => panel.sync());
}

class Field {
  readonly root: HTMLElement;
  private readonly slider: HTMLInputElement;
  private readonly number: HTMLInputElement;

  constructor(
    private readonly parameter: GaitParameter,
    private readonly onEdit: () => void,
  ) {
    const { key, label, unit, min, max, step } = parameter;
    const limits = { min, max, step };
    this.slider = h("input", { type: "range", ...limits, "aria-label": `${label}, slider` });
    this.number = h("input", { type: "number", id: `parameter-${key}`, ...limits, "aria-describedby": `limits-${key}` });
    this.slider.addEventListener("input", () => this.edit(this.slider.value));
    this.number.addEventListener("input", () => this.edit(null));
    this.root = h(
      "div",
      { class: "field" },
      h("label", { for: `parameter-${key}` }, label),
      h("span", { class: "field-entry" }, this.number, h("span", { class: "unit" }, unitSign(unit))),
      this.slider,
      h("span", { class: "field-limits muted num", id: `limits-${key}` }, `${min} to ${max}`),
    );
  }

  get key(): ParameterKey {
    return this.parameter.key;
  }

  get value(): number {
    return this.number.valueAsNumber;
  }

  get valid(): boolean {
    const { min, max } = this.parameter;
    return this.value >= min && this.value <= max;
  }

  set(value: number): void {
    this.number.value = value.toFixed(stepDecimals(this.parameter.step));
    this.show();
  }

  differs(value: number | null | undefined): boolean {
    return !(Math.abs(this.value - (value ?? NaN)) < this.parameter.step / 2);
  }

  private edit(text: string | null): void {
    if (text !== null) this.number.value = Number(text).toFixed(stepDecimals(this.parameter.step));
    this.show();
    this.onEdit();
  }

  private show(): void {
    const { min, max } = this.parameter;
    this.slider.value = String(this.value);
    this.slider.style.setProperty("--fill", `${(100 * (Number(this.slider.value) - min)) / (max - min)}%`);
    this.number.setAttribute("aria-invalid", String(!this.valid));
  }
}

class ParametersPanel {
  private entry: GaitEntry | null = null;
  private fields: Field[] = [];
  private edited = false;
  /** The values that were previewed last, and what the server said of them. */
  private previewed = "";
  private remark = "";
  private timer = 0;
  private readonly list = h("div", { class: "fields" });
  private readonly hint = h("p", { class: "hint", "aria-live": "polite" });
  private readonly summary = h("p", { class: "gait-summary" });
  private readonly noticeText = h("span");
  private readonly notice = h("p", { class: "caution", id: "gait-notice", role: "status" }, icon("warn"), this.noticeText);
  private readonly apply = h("button", { class: "button primary", type: "submit", id: "gait-apply" }, "Apply");
  private readonly restore = h("button", { class: "button", type: "button", id: "gait-defaults" }, "Defaults");
  private readonly presets = new PresetPicker(
    (values) => {
      this.fill(values);
      this.onEdit();
    },
    () => (this.fields.every((field) => field.valid) ? this.values() : null),
  );
  private readonly group = h("fieldset", {}, this.presets.root, this.list, this.notice, this.hint, h("div", { class: "row" }, this.restore, this.apply));

  constructor(private readonly app: App) {
    const form = h("form", { novalidate: true, "aria-label": "Gait parameters" }, this.summary, this.group);
    form.addEventListener("submit", (event) => {
      event.preventDefault();
      void this.send();
    });
    this.restore.addEventListener("click", () => {
      if (this.entry) this.fill(defaults(this.entry));
      this.onEdit();
    });
    byId("parameters").append(form);
  }

  /** Follow the state, but never overwrite what the operator is typing. */
  sync(): void {
    const state = this.app.state.get();
    const entry = this.app.catalogue.get().find(({ name }) => name === state?.gait.name) ?? null;
    if (entry !== this.entry) this.build(entry);
    if (entry && !this.edited) this.fill(inForce(entry, state));
    this.group.disabled = !this.app.commandable;
    this.notice.hidden = !state?.notice;
    setText(this.noticeText, state?.notice ? `${state.notice}.` : "");
    this.mark();
  }

  private build(entry: GaitEntry | null): void {
    this.entry = entry;
    this.edited = false;
    this.fields = entry?.parameters.map((parameter) => new Field(parameter, () => this.onEdit())) ?? [];
    this.presets.build(entry);
    this.list.replaceChildren(...this.fields.map((field) => field.root));
    setText(this.summary, entry?.summary ?? "");
  }

  private fill(values: ParameterValues): void {
    for (const field of this.fields) field.set(values[field.key] ?? NaN);
  }

  private onEdit(): void {
    this.edited = true;
    this.mark();
  }

  private mark(): void {
    if (!this.entry) return;
    const now = inForce(this.entry, this.app.state.get());
    const changed = this.fields.some((field) => field.differs(now[field.key]));
    if (!changed) this.edited = false;
    this.apply.disabled = !changed || !this.fields.every((field) => field.valid);
    const wrong = this.fields.find((field) => !field.valid);
    // The notice of the gait in force says more than its remark.
    const silent = !this.edited && this.app.state.get()?.notice != null;
    setText(this.hint, wrong ? "A value is outside its limits." : silent ? "" : this.remark);
    if (!wrong) this.preview();
  }

  /** Have the server judge the values in the fields, once they have not changed for a moment. */
  private preview(): void {
    const entry = this.entry;
    const values = this.values();
    const key = JSON.stringify([entry?.name, this.app.state.get()?.robot, values]);
    if (!entry || key === this.previewed || this.app.link.get().phase !== "live") return;
    this.previewed = key;
    window.clearTimeout(this.timer);
    this.timer = window.setTimeout(async () => {
      const found = await api.previewGait(entry.name, values).catch(() => null);
      if (key !== this.previewed) return;
      this.remark = found?.reason != null ? `Not possible: ${found.reason}.` : (found?.remark ?? "");
      this.mark();
    }, PREVIEW_AFTER_MS);
  }

  private values(): ParameterValues {
    return Object.fromEntries(this.fields.map((field) => [field.key, field.value]));
  }

  private async send(): Promise<void> {
    if (!this.entry) return;
    const values = this.values();
    const turn = this.app.state.get()?.gait.turn ?? 0;
    const name = this.entry.name;
    const answer = await this.app.command(() => api.setGait({ name, ...values, turn }).then(() => true));
    if (answer) this.edited = false;
    this.sync();
  }
}
