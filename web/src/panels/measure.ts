// Two clicks in the 3D view, and the distance between the points that lie there.

import { h, setText } from "../basics/dom";
import { fixed } from "../basics/format";
import { type Point, type Scene3D, distance } from "../drawing/scene";

const SVG = "http://www.w3.org/2000/svg";

export class Measure {
  private points: Point[] = [];
  private readonly line = document.createElementNS(SVG, "polyline");
  private readonly dots = [0, 1].map(() => document.createElementNS(SVG, "circle"));
  private readonly result = h("p", { class: "measure-result num", id: "measure-result", role: "status" });
  private readonly plate = h("div", { class: "measure-plate", id: "measure-plate", onclick: (event: MouseEvent) => this.add(event.offsetX, event.offsetY) });
  readonly root: HTMLElement;

  constructor(private readonly scene: Scene3D) {
    const svg = document.createElementNS(SVG, "svg");
    svg.setAttribute("aria-hidden", "true");
    svg.append(this.line, ...this.dots);
    for (const dot of this.dots) dot.setAttribute("r", "4");
    this.root = h("div", { class: "measure" }, this.plate, svg, this.result);
    this.root.hidden = true;
  }

  /** Switch on or off; return whether it is on. */
  toggle(): boolean {
    this.root.hidden = !this.root.hidden;
    this.points = [];
    this.draw();
    return !this.root.hidden;
  }

  draw(): void {
    if (this.root.hidden) return;
    const pixels = this.points.map((point) => this.scene.project(point)).filter((pixel) => pixel !== null);
    this.line.setAttribute("points", pixels.map((pixel) => pixel.map((value) => value.toFixed(1)).join(",")).join(" "));
    this.dots.forEach((dot, k) => {
      const pixel = pixels[k];
      dot.setAttribute("visibility", pixel ? "visible" : "hidden");
      if (!pixel) return;
      dot.setAttribute("cx", pixel[0].toFixed(1));
      dot.setAttribute("cy", pixel[1].toFixed(1));
    });
    setText(this.result, this.words());
  }

  private words(): string {
    const [a, b] = this.points;
    if (!a) return "Click the first point";
    if (!b) return "Click the second point";
    return `${fixed(distance(a, b), 2)} m, ${fixed(Math.abs(b[2] - a[2]), 2)} m of it in height`;
  }

  private add(x: number, y: number): void {
    const point = this.scene.pick(x, y);
    if (!point) return;
    this.points = this.points.length === 2 ? [point] : [...this.points, point];
    this.draw();
  }
}
