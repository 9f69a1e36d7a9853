// The drive pad: press and hold, by finger, mouse, Enter, keys or gamepad.

import type { App } from "../app/app";
import { type IconName, h, icon, setText } from "../basics/dom";
import { fixed } from "../basics/format";
import type { DeadmanInput } from "../app/deadman-input";
import type { Teleop } from "../app/teleop";
import "../styles/panels/pad.css";
import type { Drive } from "../types";

const BUTTONS: { id: string; icon: IconName; label: string; key: string; input: Drive }[] = [
  { id: "forward", icon: "up", label: "Forward", key: "W", input: { drive: 1, turn: 0 } },
  { id: "left", icon: "left", label: "Steer left", key: "A", input: { drive: 0, turn: 1 } },
  { id: "back", icon: "down", label: "Back", key: "S", input: { drive: -1, turn: 0 } },
  { id: "right", icon: "right", label: "Steer right", key: "D", input: { drive: 0, turn: -1 } },
];

/** The pad's element; `teleop` sends what `deadman` holds. */
export function makePad(app: App, deadman: DeadmanInput, teleop: Teleop): HTMLElement {
  const words = h("p", { class: "hint", id: "pad-words", role: "status" });
  const buttons = BUTTONS.map((button) => holdButton(deadman, button));
  const speed = h("input", { type: "range", id: "drive-speed", min: 0.2, max: 1, step: 0.1, value: 1 });
  const reading = h("output", { class: "num", for: "drive-speed" }, "100 %");
  speed.addEventListener("input", () => {
    deadman.speed = Number(speed.value);
    setText(reading, `${fixed(100 * deadman.speed, 0)} %`);
    speed.style.setProperty("--fill", `${(100 * (deadman.speed - 0.2)) / 0.8}%`);
  });
  speed.style.setProperty("--fill", "100%");
  const group = h("div", { class: "pad", role: "group", "aria-label": "Drive, press and hold", id: "pad" }, ...buttons);
  const side = h("div", { class: "pad-side" }, h("label", { for: "drive-speed" }, "Speed"), reading, speed, words);

  const show = () => {
    const { drive, turn } = deadman.drive.get();
    for (const { id, input } of BUTTONS) {
      const on = (input.drive !== 0 && Math.sign(drive) === input.drive) || (input.turn !== 0 && Math.sign(turn) === input.turn);
      const button = buttons.find((candidate) => candidate.dataset["drive"] === id);
      if (!button) continue;
      button.setAttribute("aria-pressed", String(on));
      button.disabled = !app.commandable || app.state.get()?.estop.latched === true;
    }
    setText(words, padWords(app, deadman, drive, turn));
  };
  deadman.drive.watch((input) => {
    show();
    if (input.drive === 0 || app.lease.mine) teleop.set(input);
    else void app.attempt(() => app.lease.ensure());
  });
  // With control and the socket there, what is still held counts from now on.
  teleop.ready.watch((ready) => ready && teleop.set(deadman.drive.get()));
  app.lease.current.watch((lease) => lease === null && deadman.releaseAll(null));
  app.state.watch(show);
  app.link.watch(show);
  app.role.watch(show);
  app.lease.current.watch(show);
  return h("div", { class: "pad-row" }, group, side);
}

function padWords(app: App, deadman: DeadmanInput, drive: number, turn: number): string {
  if (!app.commandable) return "";
  const direction = drive > 0 ? "Forward" : "Back";
  const side = turn === 0 ? "" : turn > 0 ? ", left" : ", right";
  if (drive !== 0) return `${direction} at ${fixed(100 * Math.abs(drive), 0)} %${side}`;
  if (turn !== 0) return "Steering needs forward or back as well.";
  return deadman.gamepad === null ? "Hold a button, or W A S D." : "Hold a button, W A S D, or the gamepad's stick; its B stops.";
}

function holdButton(deadman: DeadmanInput, { id, icon: name, label, key, input }: (typeof BUTTONS)[number]): HTMLButtonElement {
  const button = h(
    "button",
    { class: `pad-button pad-${id}`, type: "button", "data-drive": id, "aria-pressed": "false", "aria-label": label, title: `${label} (hold, or ${key})` },
    icon(name),
  );
  const source = `pad-${id}`;
  const release = () => deadman.release(source);
  button.addEventListener("pointerdown", (event) => {
    if (event.button !== 0) return;
    button.setPointerCapture(event.pointerId);
    deadman.hold(source, input);
  });
  for (const end of ["pointerup", "pointercancel", "lostpointercapture", "blur"]) button.addEventListener(end, release);
  // With a second button of the mouse down there is no pointerup for the first.
  button.addEventListener("pointermove", (event) => (event.buttons & 1) === 0 && release());
  button.addEventListener("contextmenu", (event) => event.preventDefault());
  button.addEventListener("keydown", (event) => event.key === "Enter" && !event.repeat && deadman.hold(source, input));
  button.addEventListener("keyup", (event) => event.key === "Enter" && release());
  return button;
}
