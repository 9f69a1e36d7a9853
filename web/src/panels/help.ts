// Keys and what the page's words mean.

import { byId, h } from "../basics/dom";
import { openDialog, prepareDialog } from "./dialog";

const KEYS: [string, string][] = [
  ["Space", "Emergency stop. In a field it types or opens the list, in a dialog it does what it always does. Buttons of the page are pressed with Enter, so that after a click Space still stops."],
  ["Esc", "Emergency stop. With a dialog open it only closes the dialog, in a field it only leaves the field: press it again to stop."],
  ["W A S D", "Drive while held: forward, left, back, right. On the pad the arrow keys do the same. Ctrl, Alt and Command release the drive, as the system may withhold a key-up while they are down."],
  ["Gamepad", "Left stick or cross drives while held; B (circle) is the emergency stop."],
  ["Tab", "To the next control; Enter presses it."],
];

const WORDS: [string, string][] = [
  ["Control", "One page at a time may move the robot. Another can take it over; the emergency stop is everybody's."],
  ["Emergency stop", "Latches: the robot holds still until Reset and then Start."],
  ["Yaw, yaw rate, sway", "How the head moves about its mean heading and across its direction of travel, over the last period of the gait. A steady head gives sharp images."],
  ["Head control", "Bends the front joints (the neck) against the body's swing. Arrow keys show what each controller does, Enter chooses one."],
  ["Error", "Position error against the simulator's truth; a real robot or a recording without truth has none."],
  ["Real time", "1.00 \u00d7 means that simulated time keeps up with the clock."],
];

export function mountHelp(): () => void {
  const dialog = byId("help") as HTMLDialogElement;
  const rows = (pairs: [string, string][], tag: "kbd" | "span") =>
    pairs.flatMap(([word, meaning]) => [h("dt", {}, h(tag, {}, word)), h("dd", {}, meaning)]);
  const keys = h("dl", {}, ...rows(KEYS, "kbd"));
  prepareDialog(dialog, "Keys and words", keys, h("dl", {}, ...rows(WORDS, "span")));
  return () => openDialog(dialog);
}
