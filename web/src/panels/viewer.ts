// The 3D view: viser in a frame of the same origin; a view from above stands in for it until it has drawn.

import type { App } from "../app/app";
import { byId, h, icon, setText } from "../basics/dom";
import { count } from "../basics/format";
import { type Drawn, Scene3D, type Stage } from "../drawing/scene";
import { TopView } from "../drawing/topview";
import { loadViewer } from "../app/viewer-load";
import "../styles/panels/viewer.css";
import { ViewTools } from "./viewtools";

const STEPS: Record<Exclude<Stage, "drawn">, [number, string]> = {
  program: [1, "3D view: loading the program"],
  scene: [2, "3D view: receiving robot and map"],
  frame: [3, "3D view: drawing the first frame"],
};
/** A recording may have no body to wait for. */
const LONGEST_WAIT_MS = 2000;
const NO_WEBGL = "This browser has no WebGL: the robot is drawn from above.";
const LOST_WEBGL = "The browser has stopped drawing in 3D: the robot is drawn from above. Load the page again to try anew.";

export function mountViewer(app: App, onWindow: (frame: Window) => void): void {
  const frame = byId("viewer") as HTMLIFrameElement;
  const drawable = document.createElement("canvas").getContext("webgl2") !== null;
  const panel = new ViewerPanel(app, frame, drawable);
  let liveMs: number | null = null;
  app.link.watch(({ phase }) => {
    if (phase === "live") liveMs ??= performance.now();
  });
  app.redraw.every(200, () => panel.draw());
  // The program of the 3D view takes the page's own thread for seconds: the robot is on the screen before.
  const mayLoad = () => drawable && liveMs !== null && (panel.knowsBody || performance.now() - liveMs > LONGEST_WAIT_MS);
  loadViewer(app, frame, mayLoad, (inner) => {
    // viser only reconnects while its document has the focus, which a frame seldom has.
    inner.document.hasFocus = () => true;
    inner.document.addEventListener("webglcontextlost", () => panel.loseWebgl(), { capture: true });
    onWindow(inner);
  });
}

class ViewerPanel {
  private readonly scene: Scene3D;
  private readonly tools: ViewTools;
  private readonly canvas = h("canvas", { id: "top-view", "aria-label": "Robot and path from above", role: "img" });
  private readonly top = new TopView(this.canvas);
  private readonly step = h("progress", { max: 4, value: 0, "aria-label": "Loading the 3D view" });
  private readonly words = h("p");
  private readonly loading = h("div", { class: "view-loading", id: "view-loading", role: "status" }, this.words, this.step);
  private readonly points = byId("map-points");
  private mapPoints = 0;
  private source = "";
  private lost: string | null;

  constructor(app: App, frame: HTMLIFrameElement, drawable: boolean) {
    this.lost = drawable ? null : NO_WEBGL;
    this.scene = new Scene3D(frame);
    this.tools = new ViewTools(this.scene);
    frame.after(this.canvas, ...this.tools.parts, h("div", { class: "view-top" }, this.tools.bar, this.loading));
    this.watchSession(app);
    app.tick.on((tick) => {
      this.mapPoints = tick.map_points;
      this.tools.setBody(tick.body);
      this.scene.expectsBody = (tick.body?.p_m.length ?? 0) > 3;
      const centre = this.tools.centre;
      if (tick.body && centre) this.top.follow(centre[0], centre[1]);
    });
  }

  get knowsBody(): boolean {
    return this.tools.body !== null;
  }

  loseWebgl(): void {
    this.lost = LOST_WEBGL;
  }

  draw(): void {
    const stage = this.scene.stage;
    const drawn = stage === "drawn" && this.lost === null;
    this.canvas.hidden = this.loading.hidden = drawn;
    this.canvas.dataset["stage"] = stage;
    if (drawn) this.showCounts(this.tools.draw());
    else {
      this.showCounts({ shown: 0, total: 0 });
      const centre = this.tools.centre ?? [0, 0, 0];
      this.tools.drawFromAbove(this.top.draw(this.tools.body, [centre[0], centre[1]]));
      const [step, words] = stage === "drawn" ? [0, ""] : STEPS[stage];
      setText(this.words, this.lost ?? `${words} \u2026`);
      this.step.hidden = this.lost !== null;
      this.step.value = step;
    }
  }

  private showCounts({ shown }: Drawn): void {
    setText(this.points, `${count(Math.min(shown, this.mapPoints))} of ${count(this.mapPoints)}`);
    this.points.dataset["count"] = String(this.mapPoints);
  }

  private watchSession(app: App): void {
    const cover = byId("viewer-cover");
    const words = h("p");
    cover.append(icon("cube"), words);
    app.state.watch((state) => {
      const starting = !state || state.session === "starting";
      cover.hidden = !starting && state?.session !== "failed";
      cover.dataset["kind"] = state?.session ?? "starting";
      if (state?.session === "failed") setText(words, state.message ?? "The session has failed.");
      else setText(words, state?.message ?? "Starting ...");
      const source = JSON.stringify([state?.source, starting]);
      if (source !== this.source) {
        this.top.clear();
        this.tools.forget();
      }
      this.source = source;
    });
  }
}
