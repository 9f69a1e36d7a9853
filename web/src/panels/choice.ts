// One of a few: a radio group whose arrow keys only move the focus, since choosing acts on a moving robot.

import { h } from "../basics/dom";
import "../styles/panels/choice.css";

export interface Option<Name extends string> {
  name: Name;
  title: string;
  /** Why it cannot be chosen now; null when it can. */
  reason: string | null;
}

const STEPS: Record<string, number> = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 };

export class Choice<Name extends string> {
  readonly root: HTMLElement;
  /** Called with the option that has the focus, null when none has. */
  onLook: (name: Name | null) => void = () => undefined;
  private buttons: HTMLButtonElement[] = [];
  private current: string | null = null;
  private ready = false;

  constructor(
    private readonly id: string,
    label: string,
    private readonly onChoose: (name: Name) => void,
  ) {
    this.root = h("div", { class: "choice", id, role: "radiogroup", "aria-label": label });
    this.root.addEventListener("keydown", (event) => this.step(event));
    this.root.addEventListener("focusout", () => this.onLook(null));
  }

  /** Show these options; the focus stays where it is. */
  set(options: Option<Name>[]): void {
    if (options.map(({ name }) => name).join() !== this.buttons.map(({ value }) => value).join()) {
      this.buttons = options.map((option) => this.makeButton(option));
      this.root.replaceChildren(...this.buttons);
    }
    options.forEach(({ reason }, index) => {
      const button = this.buttons[index];
      if (!button) return;
      // Not `disabled`: it must be reachable for its reason to be read.
      button.setAttribute("aria-disabled", String(reason !== null));
      button.title = reason ?? "";
    });
    this.mark(this.current, this.ready);
  }

  mark(current: string | null, ready: boolean): void {
    this.current = current;
    this.ready = ready;
    const stop = this.buttons.find(({ value }) => value === current) ?? this.buttons[0];
    for (const button of this.buttons) {
      button.setAttribute("aria-checked", String(button.value === current));
      button.disabled = !ready;
      if (!this.root.contains(document.activeElement)) button.tabIndex = button === stop ? 0 : -1;
    }
  }

  private makeButton({ name, title }: Option<Name>): HTMLButtonElement {
    const button = h(
      "button",
      { class: "choice-option", type: "button", role: "radio", id: `${this.id}-${name}`, value: name },
      title,
    );
    button.addEventListener("click", () => {
      this.onLook(name);
      if (button.ariaDisabled !== "true" && name !== this.current) this.onChoose(name);
    });
    button.addEventListener("focus", () => {
      for (const other of this.buttons) other.tabIndex = other === button ? 0 : -1;
      this.onLook(name);
    });
    return button;
  }

  private step(event: KeyboardEvent): void {
    const step = STEPS[event.key];
    const at = this.buttons.findIndex((button) => button === document.activeElement);
    if (step === undefined || at < 0) return;
    event.preventDefault();
    this.buttons[(at + step + this.buttons.length) % this.buttons.length]?.focus();
  }
}
