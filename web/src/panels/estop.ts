// The emergency stop: always there, also on Space and Escape, repeated until the server confirms it.

import { ApiError, api } from "../link/api";
import type { App } from "../app/app";
import { byId, h, icon, setText } from "../basics/dom";

const RETRY_MS = 400;

export class EStop {
  private readonly button = byId("estop") as HTMLButtonElement;
  private readonly words = h("span", { class: "estop-words" }, "E-STOP");
  private readonly banner = byId("estop-banner");
  private readonly bannerText = h("p");
  private readonly reset = h("button", { class: "button", type: "button", id: "estop-reset" }, "Reset");
  private pressed = false;
  /** The server has it and the robot has not answered. */
  private unconfirmed = false;

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
        // Without the robot's confirmation it is latched in the server only: sent again until the robot confirms it.
        this.unconfirmed = (await api.estop(reason)).confirmed === false;
        if (!this.unconfirmed) break;
        this.show();
      } catch (error) {
        // A refusal that will not change (signed out) is shown, not repeated for ever.
        if (!(error instanceof ApiError) || (error.status >= 400 && error.status < 500)) {
          this.app.report(error);
          break;
        }
      }
      await new Promise((resolve) => setTimeout(resolve, RETRY_MS));
    }
    this.pressed = this.unconfirmed = false;
    this.show();
  }

  private get latched(): boolean {
    return this.app.state.get()?.estop.latched ?? false;
  }

  private show(): void {
    const live = this.app.link.get().phase === "live";
    const waiting = this.pressed && (!this.latched || this.unconfirmed);
    this.button.dataset["state"] = waiting ? "sending" : this.latched ? "latched" : "ready";
    const words = waiting ? "STOPPING" : this.latched ? "STOPPED" : "E-STOP";
    setText(this.words, words);
    // Who speaks to the page says what stands on the button: its name begins with that.
    const meaning = waiting ? "emergency stop sent" : this.latched ? "emergency stop is latched" : "emergency stop";
    this.button.setAttribute("aria-label", `${words}, ${meaning}`);
    this.banner.hidden = !waiting && !this.latched;
    this.reset.hidden = !this.latched;
    this.reset.disabled = !live;
    setText(this.bannerText, waiting ? "Emergency stop sent, not confirmed yet. Trying again until it is." : this.reason());
  }

  private reason(): string {
    const reason = this.app.state.get()?.estop.reason;
    const why = reason ? ` (${reason})` : "";
    return `Emergency stop is latched${why}. Reset does not move the robot.`;
  }
}

const isField = (target: EventTarget | null): target is HTMLElement =>
  target instanceof HTMLTextAreaElement ||
  target instanceof HTMLSelectElement ||
  (target instanceof HTMLInputElement && ["text", "password", "search", "number"].includes(target.type));

/** What the page's own Escape closes or leaves; null where it has nothing to close, and then it stops the robot. */
function escapes(target: EventTarget | null): (() => void) | null {
  const dialog = document.querySelector<HTMLDialogElement>("dialog[open]");
  // Without a sign-in the page can do nothing, the emergency stop included.
  if (dialog) return () => dialog.id !== "signin" && dialog.close();
  if (isField(target)) return () => target.blur();
  const list = target instanceof Element ? target.closest<HTMLDetailsElement>("details[open]") : null;
  return list && (() => (list.open = false));
}

const keepsSpace = (target: EventTarget | null): boolean =>
  isField(target) || (target instanceof Element && target.closest("dialog") !== null);

/** Space and Escape stop, whether the robot moves or not, except where they have their usual work: see the help.
 *
 * On a button of the page Space stops too, since a click leaves the focus there: meant as a stop it would press Start.
 */
export function listenForStopKeys(target: Window, estop: EStop): void {
  target.addEventListener(
    "keydown",
    (event) => {
      const space = event.code === "Space" && !keepsSpace(event.target);
      // A composition of an input method has its own Escape and Space.
      if ((!space && event.key !== "Escape") || event.repeat || event.isComposing) return;
      const close = space ? null : escapes(event.target);
      if (close) return close();
      if (space) {
        event.preventDefault(); // or the focused button would be pressed as well
        event.stopPropagation();
      }
      estop.press(`${space ? "Space" : "Escape"} pressed on the page`);
    },
    { capture: true },
  );
}
