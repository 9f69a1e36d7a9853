// Scripted runs: submit, watch, read the result, cancel. One runs at a time beside the live view.

import { ApiError, api } from "../link/api";
import type { App } from "../app/app";
import { byId, h, setText } from "../basics/dom";
import { errorLine } from "../link/failure";
import { fixed, scaled } from "../basics/format";
import "../styles/panels/runs.css";
import type { Run, RunOverrides } from "../types";
import { labelled, origin } from "./source";

const POLL_MS = 1000;
const IDLE_POLLS = 10;
const active = (run: Run): boolean => run.state === "queued" || run.state === "running";

export function mountRuns(app: App): void {
  const body = h("tbody", { id: "run-rows" });
  const empty = h("p", { class: "muted runs-empty" }, "No runs yet. A run has its own simulator and leaves the live view alone.");
  byId("runs").append(runForm(app), h("div", { class: "runs-scroll", tabindex: 0, role: "group", "aria-label": "List of runs" }, table(body), empty));
  const problem = h("p", { class: "field-error", id: "runs-problem", role: "status", hidden: true });
  byId("runs").append(problem);
  app.runsProblem.watch((words) => {
    problem.hidden = words === null;
    setText(problem, words ?? "");
  });
  app.reloaded.on(() => void refreshRuns(app));
  const rows = new Map<string, Row>();
  app.runs.watch((runs) => {
    empty.hidden = runs.length > 0;
    for (const run of [...runs].reverse()) {
      let row = rows.get(run.id);
      if (!row) rows.set(run.id, (row = new Row(app, run.id)));
      row.show(run);
    }
    const order = [...runs].reverse().flatMap((run) => rows.get(run.id)?.root ?? []);
    const same = order.length === body.childElementCount && order.every((root, index) => body.children[index] === root);
    if (!same) body.replaceChildren(...order);
  });
  let polls = 0;
  window.setInterval(() => {
    const busy = app.runs.get().some(active);
    const due = busy || polls++ % IDLE_POLLS === 0;
    if (due && app.link.get().phase === "live" && !document.hidden) void refreshRuns(app);
  }, POLL_MS);
}

async function refreshRuns(app: App): Promise<void> {
  try {
    app.runs.set(await api.runs());
    app.runsProblem.set(null);
  } catch (error) {
    // A lost link and a lost sign-in are shown elsewhere on the page.
    if (error instanceof ApiError && error.status === 401) app.report(error);
    else if (app.link.get().phase === "live") app.runsProblem.set(`${errorLine(error)} What is shown may be old.`);
  }
}

function table(body: HTMLElement): HTMLElement {
  const heads = ["Run", "State", "ATE (cm)", "Tracked", "Resets", "Speed", "Files", ""];
  const cells = heads.map((text) => h("th", { scope: "col" }, text === "" ? h("span", { class: "visually-hidden" }, "Cancel") : text));
  return h("table", { class: "runs-table" }, h("thead", {}, h("tr", {}, ...cells)), body);
}

function runForm(app: App): HTMLElement {
  const gaits = h("select", { id: "run-gait" }, h("option", { value: "" }, "As configured"));
  const duration = h("input", { type: "number", id: "run-duration", min: 0.5, max: 3600, step: 0.5, value: 20 });
  const seed = h("input", { type: "number", id: "run-seed", min: 0, step: 1, value: 1 });
  const more = h("input", { type: "text", id: "run-overrides", placeholder: "sim.world=office", spellcheck: "false" });
  const form = h(
    "form",
    { class: "run-form", novalidate: true },
    labelled("Gait", gaits),
    labelled("Duration (s)", duration),
    labelled("Seed", seed),
    labelled("More settings", more),
    h("button", { class: "button primary", type: "submit", id: "run-submit" }, "Run"),
  );
  app.catalogue.watch((catalogue) => {
    const options = catalogue.map(({ name, title }) => h("option", { value: name }, title));
    gaits.replaceChildren(h("option", { value: "" }, "As configured"), ...options);
  });
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    const overrides = parseOverrides(more.value);
    const gait = app.catalogue.get().find(({ name }) => name === gaits.value);
    if (gait) overrides["gait.name"] = gait.name;
    const request = { config: "sim" as const, overrides, seed: seed.valueAsNumber, duration_s: duration.valueAsNumber };
    void app.attempt(() => api.submitRun(request)).then(() => refreshRuns(app));
  });
  return form;
}

/** "a.b=1, c.d=x" as an object; numbers and booleans become such. */
export function parseOverrides(text: string): RunOverrides {
  const overrides: Record<string, string | number | boolean> = {};
  for (const part of text.split(/[,\s]+/).filter((piece) => piece !== "")) {
    const [key = "", ...rest] = part.split("=");
    const value = rest.join("=");
    const number = Number(value);
    overrides[key] = value === "true" ? true : value === "false" ? false : value !== "" && Number.isFinite(number) ? number : value;
  }
  // Free text: the server says which key or value is wrong.
  return overrides as RunOverrides;
}

/** Gait, world, seed and length of a run, its configuration, and when it was asked for in this browser's time. */
function runFacts(run: Run): string {
  const length = run.request ? `${fixed(run.request.duration_s, 1)} s` : null;
  return [...origin(run), length, run.config].filter((part) => part !== null).join(", ");
}

class Row {
  readonly root = h("tr");
  private readonly title = h("strong");
  private readonly facts = h("span", { class: "muted" });
  private readonly state = h("td");
  private readonly bar = h("progress", { max: 1, value: 0 });
  private readonly words = h("span");
  private readonly cells = Array.from({ length: 4 }, () => h("td", { class: "num" }));
  private readonly files = h("div", { class: "run-files" });
  private readonly cancel = h("button", { class: "text-button", type: "button" }, "Cancel");
  private artifacts = "";

  constructor(app: App, private readonly id: string) {
    this.cancel.addEventListener("click", () => void app.attempt(() => api.cancelRun(id)).then(() => refreshRuns(app)));
    this.bar.setAttribute("aria-label", `Progress of run ${id}`);
    this.state.append(this.words, this.bar);
    this.root.append(h("td", {}, h("div", { class: "run-what" }, this.title, this.facts)), this.state, ...this.cells, h("td", {}, this.files), h("td", {}, this.cancel));
    this.root.dataset["run"] = id;
  }

  show(run: Run): void {
    this.root.dataset["state"] = run.state;
    this.bar.hidden = run.state !== "running";
    this.bar.value = run.progress;
    this.cancel.hidden = !active(run);
    this.cancel.setAttribute("aria-label", `Cancel ${run.name}`);
    setText(this.title, run.name);
    setText(this.facts, runFacts(run));
    setText(this.words, run.state === "running" ? `${Math.round(100 * run.progress)} %` : run.state);
    this.words.title = run.error ?? "";
    const m = run.metrics;
    const texts = [
      scaled(m?.ate_m?.posyaw, 100, 1),
      m?.tracked_fraction == null ? "\u2013" : `${fixed(100 * m.tracked_fraction, 0)} %`,
      fixed(m?.resets, 0),
      m?.speed_m_s == null ? "\u2013" : `${fixed(100 * m.speed_m_s, 1)} cm/s`,
    ];
    this.cells.forEach((cell, index) => setText(cell, texts[index] ?? ""));
    this.showFiles(run);
  }

  private showFiles(run: Run): void {
    const key = run.error ?? run.artifacts.join();
    if (key === this.artifacts) return;
    this.artifacts = key;
    if (run.error) this.files.replaceChildren(h("span", { class: "run-error" }, run.error));
    else {
      const links = run.artifacts.map((name) => h("a", { href: api.artifactUrl(this.id, name), download: name }, name));
      this.files.replaceChildren(...links);
    }
  }
}
