// The robot and its path from above on a plain canvas: what is to be seen until the 3D view has drawn, or without WebGL.

import { fitCanvas } from "../basics/dom";
import type { Body } from "../types";

// The 3D view's own colours, which are dark in both themes.
const GROUND = "#141414";
const GRID = "#2a2f36";
const PATH = "#45c9b5";
const BODY = "#d6963e";
const HEAD = "#facd5a";
const LONGEST_PATH = 2000;
const STEP_M = 0.02;
const VIEW_M = 5;
const BODY_M = 0.064;
const HEAD_M = 0.1;

export class TopView {
  private path: [number, number][] = [];

  constructor(private readonly canvas: HTMLCanvasElement) {}

  clear(): void {
    this.path = [];
  }

  /** Note where the middle of the body is. */
  follow(x: number, y: number): void {
    const last = this.path.at(-1);
    if (last && Math.hypot(x - last[0], y - last[1]) < STEP_M) return;
    this.path.push([x, y]);
    if (this.path.length > LONGEST_PATH) this.path = this.path.filter((_, k) => k % 2 === 0);
  }

  /** Draw; return how many metres one CSS pixel shows. */
  draw(body: Body | null, centre: [number, number]): number {
    fitCanvas(this.canvas);
    const context = this.canvas.getContext("2d")!;
    const { width, height } = this.canvas;
    const scale = Math.min(width, height) / VIEW_M;
    context.fillStyle = GROUND;
    context.fillRect(0, 0, width, height);
    context.save();
    context.translate(width / 2, height / 2);
    context.scale(scale, -scale);
    context.translate(-centre[0], -centre[1]);
    context.lineCap = context.lineJoin = "round";
    this.drawGrid(context, centre, (0.5 * Math.hypot(width, height)) / scale, 1 / scale);
    this.line(context, this.path, PATH, 2 / scale);
    if (body) this.drawBody(context, body);
    context.restore();
    const pixels = this.canvas.clientWidth > 0 ? width / this.canvas.clientWidth : 1;
    return pixels / scale;
  }

  private drawGrid(context: CanvasRenderingContext2D, [x, y]: [number, number], reach: number, pixel: number): void {
    context.strokeStyle = GRID;
    context.lineWidth = pixel;
    context.beginPath();
    for (let m = Math.ceil(x - reach); m <= x + reach; m++) {
      context.moveTo(m, y - reach);
      context.lineTo(m, y + reach);
    }
    for (let m = Math.ceil(y - reach); m <= y + reach; m++) {
      context.moveTo(x - reach, m);
      context.lineTo(x + reach, m);
    }
    context.stroke();
  }

  private drawBody(context: CanvasRenderingContext2D, body: Body): void {
    const points: [number, number][] = [];
    for (let k = 0; k + 1 < body.p_m.length; k += 3) points.push([body.p_m[k]!, body.p_m[k + 1]!]);
    this.line(context, points, BODY, BODY_M);
    const head = points.at(-1);
    if (!head) return;
    const yaw = (body.heading_deg * Math.PI) / 180;
    const [dx, dy] = [Math.cos(yaw), Math.sin(yaw)];
    context.fillStyle = HEAD;
    context.beginPath();
    context.arc(head[0], head[1], HEAD_M / 2, 0, 2 * Math.PI);
    context.fill();
    this.line(context, [head, [head[0] + 0.3 * dx, head[1] + 0.3 * dy]], HEAD, 0.03);
    context.beginPath();
    for (const [along, across] of [[0.44, 0], [0.28, 0.075], [0.28, -0.075]] as const)
      context.lineTo(head[0] + along * dx - across * dy, head[1] + along * dy + across * dx);
    context.fill();
  }

  private line(context: CanvasRenderingContext2D, points: [number, number][], colour: string, width: number): void {
    context.strokeStyle = colour;
    context.lineWidth = width;
    context.beginPath();
    for (const [x, y] of points) context.lineTo(x, y);
    context.stroke();
  }
}
