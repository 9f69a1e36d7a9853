// A gait's moving drawing: the body seen from above at a slant, its shadow, and the stripe along its back.

import { cssColour, fitCanvas, sizeOf } from "./dom";
import { Poser, jointAngles, type Shape, type Vec3 } from "./snake";
import type { ParameterValues } from "./types";

const SLANT = 0.62; // how far the ground is foreshortened
const LIFT = 2.4; // heights are drawn larger than life, or they would not be seen
const MARGIN = 0.08;

export class GaitDrawing {
  readonly canvas: HTMLCanvasElement;
  private readonly poser = new Poser();
  private scale = 0;

  constructor(
    private readonly name: string,
    private values: ParameterValues,
    private readonly joints: number,
  ) {
    this.canvas = document.createElement("canvas");
    this.canvas.className = "gait-drawing";
    this.canvas.setAttribute("aria-hidden", "true");
  }

  setValues(values: ParameterValues): void {
    this.values = values;
    this.scale = 0;
  }

  draw(seconds: number, active: boolean): void {
    if (sizeOf(this.canvas).width === 0) return;
    fitCanvas(this.canvas);
    const context = this.canvas.getContext("2d");
    if (!context) return;
    const phase = (2 * Math.PI * seconds) / (this.values.period_s ?? 4);
    const shape = this.poser.pose(jointAngles(this.name, this.values, this.joints, phase));
    context.clearRect(0, 0, this.canvas.width, this.canvas.height);
    this.stroke(context, shape, active);
  }

  private project(shape: Shape): { ground: [number, number][]; body: [number, number][]; width: number } {
    const { width, height } = this.canvas;
    const xs = shape.points.map((p) => p[0]);
    const ys = shape.points.flatMap((p) => [-p[1] * SLANT, -p[1] * SLANT - p[2] * LIFT]);
    const spanX = Math.max(...xs) - Math.min(...xs) + 2;
    const spanY = Math.max(...ys) - Math.min(...ys) + 3;
    const fit = Math.min((width * (1 - 2 * MARGIN)) / spanX, (height * (1 - 2 * MARGIN)) / spanY);
    // Only ever zoom out: a scale that breathes with the shape would look like motion.
    this.scale = this.scale === 0 ? fit : Math.min(this.scale, fit);
    const midY = (Math.max(...ys) + Math.min(...ys)) / 2;
    const midX = (Math.max(...xs) + Math.min(...xs)) / 2;
    const at = ([x, y, z]: Vec3, lift: number): [number, number] => [
      width / 2 + (x - midX) * this.scale,
      height / 2 + (-y * SLANT - z * lift - midY) * this.scale,
    ];
    return {
      ground: shape.points.map((p) => at(p, 0)),
      body: shape.points.map((p) => at(p, LIFT)),
      width: Math.max(2.5, Math.min(this.scale * 1.3, height / 9)),
    };
  }

  private stroke(context: CanvasRenderingContext2D, shape: Shape, active: boolean): void {
    const { ground, body, width } = this.project(shape);
    context.lineCap = "round";
    context.lineJoin = "round";
    trace(context, ground, width, cssColour("--drawing-shadow"), width * 0.5);
    trace(context, body, width, cssColour(active ? "--accent" : "--drawing-body"), 0);
    context.strokeStyle = cssColour("--drawing-stripe");
    context.lineWidth = width * 0.36;
    for (let link = 0; link + 1 < body.length; link++) {
      const back = shape.backs[link] ?? 0;
      const from = body[link];
      const to = body[link + 1];
      if (back <= 0 || !from || !to) continue;
      context.globalAlpha = Math.min(1, back * 1.3) * 0.85;
      context.beginPath();
      context.moveTo(...from);
      context.lineTo(...to);
      context.stroke();
    }
    context.globalAlpha = 1;
    const head = body[body.length - 1];
    if (!head) return;
    context.fillStyle = cssColour(active ? "--accent" : "--drawing-body");
    context.beginPath();
    context.arc(head[0], head[1], width * 0.85, 0, 2 * Math.PI);
    context.fill();
  }
}

function trace(
  context: CanvasRenderingContext2D,
  points: [number, number][],
  width: number,
  colour: string,
  drop: number,
): void {
  context.strokeStyle = colour;
  context.lineWidth = width;
  context.beginPath();
  for (const [x, y] of points) context.lineTo(x, y + drop);
  context.stroke();
}
