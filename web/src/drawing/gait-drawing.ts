// A gait's moving drawing: the body seen from above at a slant, its shadow, and the stripe along its back. The shapes
// come from the server, as samples over one period of the gait.

import { cssColour, fitCanvas, sizeOf } from "../basics/dom";
import type { GaitSamples } from "../types";

const SLANT = 0.62; // how far the ground is foreshortened
const LIFT = 2.4; // heights are drawn larger than life, or they would not be seen
const MARGIN = 0.08;

/** A body at one time: x, y, z of its points in turn, and how far each link's back faces up. */
interface Shape {
  points: number[];
  backs: number[];
}

type Point2 = [number, number];

/** The extent of a drawing on the canvas, in joint lengths. */
interface Extent {
  width: number;
  height: number;
}

export class GaitDrawing {
  readonly canvas: HTMLCanvasElement;
  private samples: GaitSamples | null = null;
  private extent: Extent = { width: 1, height: 1 };
  private period_s = 1;

  constructor() {
    this.canvas = document.createElement("canvas");
    this.canvas.className = "gait-drawing";
    this.canvas.setAttribute("aria-hidden", "true");
  }

  /** Draw these shapes from now on; null: nothing. */
  show(samples: GaitSamples | null, period_s: number): void {
    this.samples = samples;
    this.period_s = period_s;
    if (samples) this.extent = extentOf(samples);
  }

  draw(seconds: number, active: boolean): void {
    if (sizeOf(this.canvas).width === 0) return;
    fitCanvas(this.canvas);
    const context = this.canvas.getContext("2d");
    if (!context) return;
    context.clearRect(0, 0, this.canvas.width, this.canvas.height);
    if (this.samples) this.stroke(context, shapeAt(this.samples, seconds / this.period_s), active);
  }

  private project({ points }: Shape): { ground: Point2[]; body: Point2[]; width: number } {
    const { width, height } = this.canvas;
    const free = 1 - 2 * MARGIN;
    // The extent is that of the whole period: a scale that changes with the shape would look like motion.
    const scale = Math.min((width * free) / this.extent.width, (height * free) / this.extent.height);
    const [left, right, bottom, top] = box(points);
    const at = (k: number, lift: number): Point2 => [
      width / 2 + (points[k]! - (left + right) / 2) * scale,
      height / 2 + (-points[k + 1]! * SLANT - points[k + 2]! * lift - (bottom + top) / 2) * scale,
    ];
    const starts = Array.from({ length: points.length / 3 }, (_, link) => 3 * link);
    return {
      ground: starts.map((k) => at(k, 0)),
      body: starts.map((k) => at(k, LIFT)),
      width: Math.max(2.5, Math.min(scale * 1.3, height / 9)),
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

/** The shape at a share of the period, between the two samples around it. */
function shapeAt({ points, backs }: GaitSamples, periods: number): Shape {
  const at = (periods - Math.floor(periods)) * points.length;
  const before = Math.floor(at) % points.length;
  const after = (before + 1) % points.length;
  const share = at - Math.floor(at);
  const between = (rows: number[][]) => rows[before]!.map((value, k) => value + share * (rows[after]![k]! - value));
  return { points: between(points), backs: between(backs) };
}

/** Left, right, bottom and top of a shape and its shadow as they are drawn, in joint lengths. */
function box(points: number[]): [number, number, number, number] {
  let [left, right, bottom, top] = [Infinity, -Infinity, Infinity, -Infinity];
  for (let k = 0; k < points.length; k += 3) {
    const ground = -points[k + 1]! * SLANT;
    left = Math.min(left, points[k]!);
    right = Math.max(right, points[k]!);
    bottom = Math.min(bottom, ground - points[k + 2]! * LIFT);
    top = Math.max(top, ground);
  }
  return [left, right, bottom, top];
}

function extentOf({ points }: GaitSamples): Extent {
  const boxes = points.map(box);
  // Room for the body's own width, the head and the shadow.
  return {
    width: Math.max(...boxes.map(([left, right]) => right - left)) + 2,
    height: Math.max(...boxes.map(([, , bottom, top]) => top - bottom)) + 3,
  };
}

function trace(context: CanvasRenderingContext2D, points: Point2[], width: number, colour: string, drop: number): void {
  context.strokeStyle = colour;
  context.lineWidth = width;
  context.beginPath();
  for (const [x, y] of points) context.lineTo(x, y + drop);
  context.stroke();
}
