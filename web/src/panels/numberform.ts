// One number with its unit and limits, sent by its button or by Enter.

import { h, setText } from "../basics/dom";
import "../styles/panels/numberform.css";

export interface NumberFormOptions {
  id: string;
  /** What is written before it; null for nothing. */
  label: string | null;
  /** Its full name. */
  spoken: string;
  unit: string;
  step: number;
  button: string;}

export class NumberForm {
  readonly root: HTMLElement;
  private readonly number: HTMLInputElement;
  private readonly button: HTMLButtonElement;
  private readonly range: HTMLElement;
  private readonly group: HTMLFieldSetElement;
  private inForce: number | null = null;
  private edited = false;

  constructor({ id, label, spoken, unit, step, button }: NumberFormOptions, onSend: (value: number) => void) {
    this.number = h("input", { type: "number", id, step, "aria-label": spoken, "aria-describedby": `${id}-limits` });
    this.button = h("button", { class: "button", type: "submit", id: `${id}-set` }, button);
    this.range = h("span", { class: "visually-hidden", id: `${id}-limits` });
    this.group = h(
      "fieldset",
      { class: "number-form" },
      label !== null && h("label", { for: id }, label),
      this.number,
      h("span", { class: "unit" }, unit),
      this.range,
      this.button,
    );
    this.root = h("form", { novalidate: true }, this.group);
    this.number.addEventListener("input", () => {
      this.edited = true;
      this.mark();
    });
    this.root.addEventListener("submit", (event) => {
      event.preventDefault();
      if (this.button.disabled) return;
      this.edited = false;
      onSend(this.number.valueAsNumber);
    });
  }

  limits(min: number, max: number): void {
    this.number.min = String(min);
    this.number.max = String(max);
    setText(this.range, `${min} to ${max}`);
    this.number.title = `${min} to ${max}`;
    this.mark();
  }

  /** Show the value in force, but never over what the operator is typing; null when there is none to follow. */
  follow(value: number | null): void {
    this.inForce = value;
    if (value !== null && !this.edited) this.number.value = String(value);
    this.mark();
  }

  preset(value: number): void {
    this.number.value = String(value);
    this.mark();
  }

  enable(enabled: boolean): void {
    this.group.disabled = !enabled;
    this.mark();
  }

  private mark(): void {
    const value = this.number.valueAsNumber;
    const valid = value >= Number(this.number.min) && value <= Number(this.number.max) && !this.number.validity.stepMismatch;
    if (value === this.inForce) this.edited = false;
    this.number.setAttribute("aria-invalid", String(!valid && !this.group.disabled));
    this.button.disabled = !valid || value === (this.inForce ?? 0);
  }
}
