// The emergency stop: always there, also on Space and Escape, repeated until the server confirms it.

import { ApiError, api } from "../api";
import type { App } from "../app";
import { byId, h, icon, setText } from "../dom";

const RETRY_MS = 400;

export class EStop {
  private readonly button = byId("estop") as HTMLButtonElement;
  private readonly words = h("span", { class: "estop-words" }, "E-STOP");
  private readonly banner = byId("estop-banner");
  private readonly bannerText = h("p");
  private readonly reset = h("button", { class: "button", type: "button", id: "estop-reset" }, "Reset");
  private pressed = false;

  constructor(private readonly app: App) {
    this.button.append(icon("octagon"), this.words);
    this.banner.append(icon("octagon"), this.bannerText, this.reset);
    this.button.addEventListener("click", () => this.press("E-stop pressed on the page"));
    this.reset.addEventListener("click", () => void app.command(() => api.resetEstop()));
    app.state.watch(() => this.show());
    app.link.watch(() => this.show());
  }

  press(reason: string): void {
    if (this.pressed) return;
    this.pressed = true;
    this.show();
    void this.sendUntilConfirmed(reason);
  }

  private async sendUntilConfirmed(reason: string): Promise<void> {
    for (;;) {
      try {
        await api.estop(reason);
        break;
      } catch (error) {
        // A refusal that will not change (signed out) is shown, not repeated for ever.
        if (!(error instanceof ApiError) || (error.status >= 400 && error.status < 500)) {
          this.app.report(error);
          break;
        }
        await new Promise((resolve) => setTimeout(resolve, RETRY_MS));
      }
    }
    this.pressed = false;
    this.show();
  }

  private get latched(): boolean {
    return this.app.state.get()?.estop.latched ?? false;
  }

  private show(): void {
    const live = this.app.link.get().phase === "live";
    const waiting = this.pressed && !this.latched;
    this.button.dataset["state"] = waiting ? "sending" : this.latched ? "latched" : "ready";
    setText(this.words, waiting ? "STOPPING" : this.latched ? "STOPPED" : "E-STOP");
    this.banner.hidden = !waiting && !this.latched;
    this.reset.hidden = !this.latched;
    this.reset.disabled = !live;
    setText(this.bannerText, waiting ? "Emergency stop sent, not confirmed yet. Trying again until it is." : this.reason());
  }

  private reason(): string {
    const reason = this.app.state.get()?.estop.reason;
    const why = reason ? ` (${reason})` : "";
    return `Emergency stop is latched${why}. After Reset the robot stays at rest until it is started.`;
  }
}

const isTextField = (target: EventTarget | null): boolean =>
  target instanceof HTMLTextAreaElement ||
  (target instanceof HTMLInputElement && ["text", "password", "search"].includes(target.type));

/** Space (outside text fields) and Escape stop; with the robot at rest Escape only closes an open dialog. */
export function listenForStopKeys(target: Window, app: App, estop: EStop): void {
  target.addEventListener(
    "keydown",
    (event) => {
      const space = event.code === "Space" && !isTextField(event.target);
      if ((!space && event.key !== "Escape") || event.repeat) return;
      const dialog = space ? null : document.querySelector<HTMLDialogElement>("dialog[open]:not(#signin)");
      dialog?.close();
      if (dialog && !app.state.get()?.moving) return;
      if (space) {
        event.preventDefault(); // or the focused button would be pressed as well
        event.stopPropagation();
      }
      estop.press(`${space ? "Space" : "Escape"} pressed on the page`);
    },
    { capture: true },
  );
}
