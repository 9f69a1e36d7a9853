// Dialogs that leave the rest of the page alive: a modal one would take the emergency stop out of reach.

import { h } from "../basics/dom";

/** Fill a dialog with a heading and its content; it closes on its button, on a click beside it, or on Escape. */
export function prepareDialog(dialog: HTMLDialogElement, title: string, ...content: HTMLElement[]): void {
  const close = h("button", { class: "text-button", type: "button", onclick: () => dialog.close() }, "Close");
  dialog.append(h("div", { class: "dialog-head" }, h("h2", {}, title), close), ...content);
  document.addEventListener("pointerdown", (event) => {
    const target = event.target as Element;
    if (dialog.open && !dialog.contains(target) && target.closest(".topbar, .banners") === null) dialog.close();
  });
}

/** Open it and move the focus inside; give the focus back when it closes. */
export function openDialog(dialog: HTMLDialogElement): void {
  if (dialog.open) return;
  const before = document.activeElement;
  dialog.addEventListener("close", () => before instanceof HTMLElement && before.focus(), { once: true });
  dialog.show();
}
