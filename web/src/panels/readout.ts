// One measured value: its name, the number with its unit, and optionally its trend.

import { h, setText } from "../dom";
import { Sparkline } from "../sparkline";

export interface ReadoutOptions {
  id: string;
  label: string;
  unit: string;
  title?: string;
  trend?: Sparkline;
}

export class Readout {
  readonly root: HTMLElement;
  private readonly number = h("span", { class: "num" }, "\u2013");
  private readonly trend: Sparkline | undefined;

  constructor({ id, label, unit, title, trend }: ReadoutOptions) {
    this.number.id = id;
    this.trend = trend;
    this.root = h(
      "div",
      { class: "readout", title: title ?? null },
      h("span", { class: "readout-label" }, label),
      trend?.canvas ?? h("span"),
      h("span", { class: "readout-value" }, this.number, h("span", { class: "unit" }, unit)),
    );
  }

  set(text: string, value?: number | null): void {
    setText(this.number, text);
    if (value !== undefined) this.trend?.push(value);
  }

  draw(): void {
    this.trend?.draw();
  }
}
