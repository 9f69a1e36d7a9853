// One measured value: its name, the number with its unit, and optionally its trend.

import { h, setText } from "../basics/dom";
import { Sparkline } from "../drawing/sparkline";
import "../styles/panels/readout.css";

export interface ReadoutOptions {
  id: string;
  label: string;
  unit: string;
  title?: string;
  trend?: Sparkline;
  /** A second line under the name, set by `setDetail`. */
  detail?: boolean;
}

export class Readout {
  readonly root: HTMLElement;
  private readonly number = h("span", { class: "num" }, "\u2013");
  private text = "\u2013";
  private detailText = "";
  private readonly trend: Sparkline | undefined;
  private readonly detail = h("span", { class: "readout-detail num" });

  constructor({ id, label, unit, title, trend, detail }: ReadoutOptions) {
    this.number.id = id;
    this.detail.id = `${id}-detail`;
    this.trend = trend;
    this.root = h(
      "div",
      { class: "readout", title: title ?? null },
      h("span", { class: "readout-label" }, label, detail === true && this.detail),
      trend?.canvas ?? h("span"),
      h("span", { class: "readout-value" }, this.number, h("span", { class: "unit" }, unit)),
    );
  }

  set(text: string, value?: number | null): void {
    this.text = text;
    if (value !== undefined) this.trend?.push(value);
  }

  /** Forget the value and its trend. */
  clear(): void {
    this.text = "\u2013";
    this.detailText = "";
    this.trend?.clear();
  }

  /** Nothing is known of the time since the last value. */
  gap(): void {
    this.trend?.push(null);
  }

  setDetail(text: string): void {
    this.detailText = text;
  }

  /** Show what was set last. */
  draw(): void {
    setText(this.number, this.text);
    setText(this.detail, this.detailText);
    this.trend?.draw();
  }
}
