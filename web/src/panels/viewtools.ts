// Above the 3D view: camera positions, layers, measuring, compass and scale bar. All of it is this browser's own.

import { h, setText } from "../basics/dom";
import { fixed } from "../basics/format";
import { type Drawn, type Layer, type Point, type Scene3D, distance, plus } from "../drawing/scene";
import "../styles/panels/viewtools.css";
import type { Body } from "../types";
import { Measure } from "./measure";

const LAYERS: [Layer, string][] = [
  ["map", "Map"],
  ["estimate", "Estimated path"],
  ["truth", "True path"],
  ["body", "Body"],
  ["camera", "Camera"],
];
/** From the middle of the body: as the server places a camera that has not been moved (server/viewer.py). */
const VIEW_FROM_M: Point = [-1.2, -1.8, 1.7];
const TOP_MARGIN = 1.9;
const LEAST_FIT_M = 1.2;
const FOLLOW_STEP_M = 0.005;
const SCALE_PX = 110;

const DRAWINGS = {
  follow: '<circle cx="10" cy="10" r="3"/><path d="M10 2v4M10 14v4M2 10h4M14 10h4"/>',
  behind: '<path d="M3 15l7-4 7 4M10 11V4M7 7l3-3 3 3"/>',
  top: '<path d="M10 3v8M7 8l3 3 3-3M3 14l7 3.500 7-3.500"/>',
  fit: '<path d="M3 7V3h4M13 3h4v4M17 13v4h-4M7 17H3v-4"/><rect x="7" y="7" width="6" height="6"/>',
  reset: '<path d="M4 10a6 6 0 1 1 2 4.500M4 16v-4h4"/>',
  layers: '<path d="M10 3l7 4-7 4-7-4zM3 11l7 4 7-4"/>',
  measure: '<path d="M3 14L14 3l3 3L6 17zM7 10l2 2M10 7l2 2"/>',
  save: '<path d="M10 3v9M6 8.500l4 4 4-4M4 16.500h12"/>',
} as const;

export class ViewTools {
  body: Body | null = null;
  centre: Point | null = null;
  private head: Point | null = null;
  /** The centre for which the camera stands where it is. */
  private followed: Point | null = null;
  private following = true;
  private placed = false;
  private readonly measure: Measure;
  private readonly follow = tool("follow", "Follow", "Move the camera along with the robot", () => this.setFollowing(!this.following));
  private readonly buttons = [
    this.follow,
    tool("behind", "Behind the head", "Look ahead from behind the head", () => this.lookAhead()),
    tool("top", "Top", "Look straight down, world x up", () => this.lookDown()),
    tool("fit", "Fit", "Show the whole map", () => this.fit()),
    tool("reset", "Reset", "Show the robot and follow it", () => this.reset()),
  ];
  private readonly ruler = tool("measure", "Measure", "Click two points of the map or the floor", () => this.toggleMeasure());
  private readonly needle = h("div", { class: "compass-needle" }, h("span", { class: "compass-x" }, "x"), h("span", { class: "compass-y" }, "y"));
  private readonly scale = h("span", { class: "scale-bar num", id: "view-scale" });
  readonly bar: HTMLElement;
  readonly parts: HTMLElement[];

  constructor(private readonly scene: Scene3D) {
    this.measure = new Measure(scene);
    const save = { class: "view-tool", href: "/api/v1/map.ply", download: "map.ply", id: "view-save", title: "Download the map as a PLY file", "aria-label": "Download the map as a PLY file" };
    const group = { class: "view-tools", id: "view-tools", role: "toolbar", "aria-label": "3D view" };
    this.bar = h("div", group, ...this.buttons, this.layers(), this.ruler, h("a", save, drawing("save"), h("span", {}, "PLY")));
    const words = "World axes: x and y of the estimate's world; north is not known";
    const compass = h("div", { class: "compass", id: "view-compass", role: "img", "aria-label": words, title: words }, this.needle);
    this.parts = [this.measure.root, h("div", { class: "view-scale" }, this.scale, compass)];
    this.setFollowing(true);
  }

  setBody(body: Body | null): void {
    if (!body || body.p_m.length < 3) return;
    this.body = body;
    const sum: Point = [0, 0, 0];
    for (let k = 0; k < body.p_m.length; k++) sum[k % 3]! += body.p_m[k]!;
    this.centre = sum.map((value) => (3 * value) / body.p_m.length) as Point;
    this.head = body.p_m.slice(-3) as Point;
  }

  /** Another session: nothing is known of its robot. */
  forget(): void {
    this.body = this.centre = this.head = this.followed = null;
    this.placed = false;
  }

  /** Bring what lies over the 3D view up to date; return how much of the map is drawn. */
  draw(): Drawn {
    this.enable(true);
    if (!this.placed && this.centre && this.scene.ready) {
      this.placed = true;
      this.reset();
    }
    this.moveAlong();
    const [from, to] = [this.scene.position, this.scene.target];
    if (from && to) this.turnCompass(Math.atan2(to[1] - from[1], to[0] - from[0]));
    this.drawScale(this.scene.metresPerPixel);
    this.measure.draw();
    return this.scene.layOut(this.centre ?? to ?? [0, 0, 0]);
  }

  drawFromAbove(metresPerPixel: number): void {
    this.enable(false);
    this.turnCompass(Math.PI / 2);
    this.drawScale(metresPerPixel);
  }

  private enable(on: boolean): void {
    for (const button of [...this.buttons, this.ruler]) button.disabled = !on;
  }

  private setFollowing(on: boolean): void {
    this.following = on;
    this.followed = this.centre;
    this.follow.setAttribute("aria-pressed", String(on));
  }

  private moveAlong(): void {
    const [centre, before] = [this.centre, this.followed];
    if (!this.following || !centre) return;
    if (before === null) this.followed = centre;
    else if (distance(centre, before) > FOLLOW_STEP_M) {
      this.scene.shift([centre[0] - before[0], centre[1] - before[1], centre[2] - before[2]]);
      this.followed = centre;
    }
  }

  private moveCamera(from: Point, to: Point): void {
    this.scene.moveCamera(from, to);
    this.followed = this.centre;
  }

  private reset(): void {
    this.setFollowing(true);
    const centre = this.centre ?? [0, 0, 0];
    this.moveCamera(plus(centre, VIEW_FROM_M), centre);
  }

  private lookAhead(): void {
    const [head, body] = [this.head, this.body];
    if (!head || !body) return;
    const yaw = (body.heading_deg * Math.PI) / 180;
    const [x, y] = [Math.cos(yaw), Math.sin(yaw)];
    this.moveCamera(plus(head, [-1.1 * x, -1.1 * y, 0.7]), plus(head, [0.7 * x, 0.7 * y, 0]));
  }

  private lookDown(): void {
    const points = this.bodyPoints;
    const centre = this.centre ?? this.scene.target;
    if (!centre) return;
    const reach = Math.max(LEAST_FIT_M, ...points.map((point) => distance(point, centre)));
    this.moveCamera(plus(centre, [-0.01, 0, (TOP_MARGIN * reach) / Math.tan(this.scene.halfView)]), centre);
  }

  /** Stand off far enough, in the present direction, that body and map are in view. */
  private fit(): void {
    const points = [...this.bodyPoints, ...this.scene.chunkPlaces];
    const [from, to] = [this.scene.position, this.scene.target];
    if (points.length === 0 || !from || !to) return;
    this.setFollowing(false);
    const middle = [0, 1, 2].map((k) => (Math.min(...points.map((p) => p[k]!)) + Math.max(...points.map((p) => p[k]!))) / 2) as Point;
    // A chunk lies up to a few metres before its keyframe.
    const reach = Math.max(LEAST_FIT_M, ...points.map((point) => distance(point, middle))) + (points.length > this.bodyPoints.length ? 1.5 : 0);
    const off = reach / Math.sin(this.scene.halfView) / Math.max(distance(from, to), 1e-6);
    this.moveCamera(plus(middle, [(from[0] - to[0]) * off, (from[1] - to[1]) * off, (from[2] - to[2]) * off]), middle);
  }

  private get bodyPoints(): Point[] {
    const p = this.body?.p_m ?? [];
    return Array.from({ length: Math.floor(p.length / 3) }, (_, k) => [p[3 * k]!, p[3 * k + 1]!, p[3 * k + 2]!]);
  }

  private toggleMeasure(): void {
    this.ruler.setAttribute("aria-pressed", String(this.measure.toggle()));
  }

  /** Screen up is the direction of view on the ground. */
  private turnCompass(view_rad: number): void {
    const turned = `${((view_rad * 180) / Math.PI - 90).toFixed(1)}deg`;
    if (this.needle.style.getPropertyValue("--turn") !== turned) this.needle.style.setProperty("--turn", turned);
  }

  private drawScale(metresPerPixel: number | null): void {
    if (metresPerPixel === null || !(metresPerPixel > 0)) return;
    const most = SCALE_PX * metresPerPixel;
    const power = 10 ** Math.floor(Math.log10(most));
    const metres = [5, 2, 1].map((k) => k * power).find((length) => length <= most) ?? power;
    this.scale.style.width = `${Math.round(metres / metresPerPixel)}px`;
    setText(this.scale, metres >= 1 ? `${fixed(metres, 0)} m` : `${fixed(metres * 100, 0)} cm`);
  }

  private layers(): HTMLElement {
    const boxes = LAYERS.map(([layer, label]) => {
      const onchange = (event: Event) => this.scene.show(layer, (event.target as HTMLInputElement).checked);
      return h("label", {}, h("input", { type: "checkbox", checked: true, id: `layer-${layer}`, onchange }), label);
    });
    const oninput = (event: Event) => (this.scene.pointSizeM = Number((event.target as HTMLInputElement).value) / 1000);
    const size = h("input", { type: "range", id: "point-size", min: 4, max: 40, step: 2, value: 16, oninput });
    const open = h("button", { class: "view-tool", type: "button", id: "view-layers", "aria-expanded": "false", "aria-controls": "layer-menu", "aria-label": "Layers", title: "What is drawn" }, drawing("layers"), h("span", {}, "Layers"));
    const menu = h("div", { class: "layer-menu", id: "layer-menu", role: "group", "aria-label": "Layers" }, ...boxes, h("label", { class: "point-size" }, "Point size", size));
    menu.hidden = true;
    open.addEventListener("click", () => {
      menu.hidden = !menu.hidden;
      open.setAttribute("aria-expanded", String(!menu.hidden));
    });
    return h("div", { class: "layer-box" }, open, menu);
  }
}

function tool(name: keyof typeof DRAWINGS, label: string, title: string, onclick: () => void): HTMLButtonElement {
  return h("button", { class: "view-tool", type: "button", id: `view-${name}`, title, "aria-label": label, onclick }, drawing(name), h("span", {}, label));
}

function drawing(name: keyof typeof DRAWINGS): SVGSVGElement {
  const template = document.createElement("template");
  template.innerHTML =
    '<svg class="icon" viewBox="0 0 20 20" fill="none" stroke="currentColor" stroke-width="1.600" ' +
    `stroke-linecap="round" stroke-linejoin="round" aria-hidden="true">${DRAWINGS[name]}</svg>`;
  return template.content.firstChild as SVGSVGElement;
}
