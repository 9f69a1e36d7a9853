// The sign-in form, shown when the server answers 401.

import { api } from "../link/api";
import type { App } from "../app/app";
import { byId, h, setText } from "../basics/dom";
import { errorLine } from "../link/failure";
import "../styles/panels/signin.css";
import { openDialog } from "./dialog";

export function mountSignIn(app: App, onSignedIn: () => void): void {
  const dialog = byId("signin") as HTMLDialogElement;
  const token = h("input", { id: "token", type: "password", autocomplete: "off", required: true, spellcheck: "false" });
  const problem = h("p", { class: "field-error", role: "alert" });
  const form = h(
    "form",
    {},
    h("h2", {}, "Sign in"),
    h("p", {}, "Open the one-time address that ", h("code", {}, "snakeslam serve"), " printed, or paste the access token."),
    h("label", { for: "token" }, "Access token"),
    token,
    problem,
    h("button", { class: "button primary", type: "submit" }, "Sign in"),
  );
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    void signIn();
  });
  const signIn = async () => {
    setText(problem, "");
    try {
      await api.signIn(token.value.trim());
      token.value = "";
      dialog.close();
      onSignedIn();
    } catch (error) {
      setText(problem, errorLine(error));
    }
  };
  dialog.append(form);
  app.link.watch(({ phase }) => {
    if (phase === "signed-out" && !dialog.open) openDialog(dialog);
  });
}
