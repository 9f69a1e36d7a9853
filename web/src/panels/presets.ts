// Named parameter sets of a gait: those of the page and those the operator has saved in this browser.

import { h } from "../basics/dom";
import type { GaitEntry, ParameterValues } from "../types";
import { defaults } from "./gaits";

type Presets = Record<string, ParameterValues>;
const KEY = "snakeslam-presets";

function saved(gait: string): Presets {
  try {
    const all = JSON.parse(localStorage.getItem(KEY) ?? "{}") as Record<string, Presets>;
    return all[gait] ?? {};
  } catch {
    return {}; // storage switched off, or not ours
  }
}

function store(gait: string, presets: Presets): void {
  try {
    const all = JSON.parse(localStorage.getItem(KEY) ?? "{}") as Record<string, Presets>;
    localStorage.setItem(KEY, JSON.stringify({ ...all, [gait]: presets }));
  } catch {
    // Not kept; the fields still hold the values.
  }
}

/** Values over the gait's defaults, kept within its limits and steps. */
function within(entry: GaitEntry, change: (key: string, value: number) => number): ParameterValues {
  const values = entry.parameters.map(({ key, min, max, step, default: value }) => {
    const wanted = Math.max(min, Math.min(max, change(key, value)));
    return [key, Math.round(wanted / step) * step] as const;
  });
  return Object.fromEntries(values);
}

function builtIn(entry: GaitEntry): Presets {
  const slow = (factor: number, size: number) => (key: string, value: number) =>
    key === "period_s" ? value * factor : key === "alpha_pi" || key === "amplitude_deg" ? value * size : value;
  return {
    Default: defaults(entry),
    Calm: within(entry, slow(2, 1)),
    "Small and calm": within(entry, slow(2, 0.5)),
  };
}

/** Choosing fills the fields through `fill`; saving keeps what `current` says under a name. */
export class PresetPicker {
  readonly root: HTMLElement;
  private entry: GaitEntry | null = null;
  private readonly choice = h("select", { id: "preset" });
  private readonly name = h("input", { type: "text", id: "preset-name", maxlength: 30, placeholder: "Name", "aria-label": "Name of the preset to save" });
  private readonly keep = h("button", { class: "button", type: "button", id: "preset-save" }, "Save");
  private readonly forget = h("button", { class: "button", type: "button", id: "preset-forget" }, "Delete");

  constructor(fill: (values: ParameterValues) => void, current: () => ParameterValues | null) {
    this.choice.addEventListener("change", () => {
      const values = this.all()[this.choice.value];
      this.forget.disabled = !(this.entry && this.choice.value in saved(this.entry.name));
      if (values) fill(values);
    });
    this.keep.addEventListener("click", () => {
      const values = current();
      const name = this.name.value.trim();
      if (!this.entry || !values || name === "") return this.name.focus();
      store(this.entry.name, { ...saved(this.entry.name), [name]: values });
      this.name.value = "";
      this.build(this.entry, name);
    });
    this.forget.addEventListener("click", () => {
      if (!this.entry) return;
      const { [this.choice.value]: _, ...rest } = saved(this.entry.name);
      store(this.entry.name, rest);
      this.build(this.entry);
    });
    this.root = h(
      "div",
      { class: "presets" },
      h("label", { for: "preset" }, "Preset"),
      this.choice,
      h("details", {}, h("summary", {}, "Save or delete"), h("div", { class: "row" }, this.name, this.keep, this.forget)),
    );
  }

  build(entry: GaitEntry | null, chosen = ""): void {
    this.entry = entry;
    const names = Object.keys(this.all());
    const options = names.map((name) => h("option", { value: name }, name));
    this.choice.replaceChildren(h("option", { value: "" }, "Choose"), ...options);
    this.choice.value = chosen;
    this.forget.disabled = !(entry && chosen in saved(entry.name));
  }

  private all(): Presets {
    return this.entry ? { ...builtIn(this.entry), ...saved(this.entry.name) } : {};
  }
}
