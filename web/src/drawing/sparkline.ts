// A tiny trend line of the last seconds of one value.

import { cssColour, fitCanvas } from "../basics/dom";

export class Sparkline {
  readonly canvas: HTMLCanvasElement;
  private readonly values: number[] = [];

  constructor(
    private readonly capacity = 300,
    /** The least range shown, so that the noise of a stationary robot does not look like motion. */
    private readonly minimumSpan = 1,
    private readonly symmetric = false,
  ) {
    this.canvas = document.createElement("canvas");
    this.canvas.className = "sparkline";
    this.canvas.setAttribute("aria-hidden", "true");
  }

  push(value: number | null): void {
    this.values.push(value ?? NaN);
    if (this.values.length > this.capacity) this.values.shift();
  }

  clear(): void {
    this.values.length = 0;
  }

  draw(): void {
    fitCanvas(this.canvas);
    const context = this.canvas.getContext("2d");
    const known = this.values.filter(Number.isFinite);
    if (!context) return;
    const { width, height } = this.canvas;
    context.clearRect(0, 0, width, height);
    if (known.length < 2) return;
    const [low, high] = this.range(known);
    const y = (value: number) => height - 3 - ((value - low) / (high - low)) * (height - 6);
    if (this.symmetric) this.rule(context, y(0), width);
    context.strokeStyle = cssColour("--accent");
    context.lineWidth = 1.5 * Math.min(window.devicePixelRatio || 1, 2);
    context.lineJoin = "round";
    context.beginPath();
    let pen = false;
    this.values.forEach((value, index) => {
      const x = width - ((this.values.length - 1 - index) / (this.capacity - 1)) * width;
      if (!Number.isFinite(value)) pen = false;
      else if (pen) context.lineTo(x, y(value));
      else context.moveTo(x, y(value));
      pen = Number.isFinite(value);
    });
    context.stroke();
  }

  private range(known: number[]): [number, number] {
    if (this.symmetric) {
      const reach = Math.max(this.minimumSpan / 2, ...known.map(Math.abs));
      return [-reach, reach];
    }
    const low = Math.min(...known);
    const high = Math.max(...known);
    const pad = Math.max(0, this.minimumSpan - (high - low)) / 2;
    return [low - pad, high + pad];
  }

  private rule(context: CanvasRenderingContext2D, y: number, width: number): void {
    context.strokeStyle = cssColour("--border");
    context.lineWidth = 1;
    context.beginPath();
    context.moveTo(0, y);
    context.lineTo(width, y);
    context.stroke();
  }
}
