// All joints over the last seconds: one row each, head at the top, so that a wave is seen travelling down the body.

import { GAP_S, type JointHistory } from "../app/history";
import { cssColour } from "../basics/dom";

type Rgb = [number, number, number];

function rgb(name: string): Rgb {
  const value = cssColour(name).replace("#", "");
  return [0, 2, 4].map((at) => parseInt(value.slice(at, at + 2), 16)) as Rgb;
}

export class Heatmap {
  readonly canvas = document.createElement("canvas");
  private readonly columns = 240;

  constructor(private readonly onPick: (joint: number) => void) {
    this.canvas.className = "heatmap";
    this.canvas.setAttribute("role", "img");
    this.canvas.setAttribute("aria-label", "Measured angle of every joint over the last seconds, head at the top");
    this.canvas.addEventListener("click", (event) => {
      if (this.canvas.height === 0) return;
      const row = Math.floor((event.offsetY / this.canvas.clientHeight) * this.canvas.height);
      this.onPick(this.canvas.height - row);
    });
  }

  clear(): void {
    this.canvas.width = this.columns;
  }

  /** Returns the angle in deg at which the colours are full. */
  draw(history: JointHistory): number {
    const rows = history.joints;
    const context = this.canvas.getContext("2d");
    if (!context || rows === 0) return 0;
    if (this.canvas.height !== rows || this.canvas.width !== this.columns) {
      this.canvas.height = rows;
      this.canvas.width = this.columns;
    }
    const reach = this.reach(history);
    const [low, zero, high] = [rgb("--heat-low"), rgb("--heat-zero"), rgb("--heat-high")];
    const image = context.createImageData(this.columns, rows);
    const { samples } = history;
    let at = 0;
    for (let column = 0; column < this.columns; column++) {
      const t_s = history.end_s - history.window_s * (1 - column / (this.columns - 1));
      while (at + 1 < samples.length && (samples[at + 1]?.t_s ?? 0) <= t_s) at++;
      const sample = samples[at];
      // Columns of which nothing is known stay empty.
      if (!sample || Math.abs(sample.t_s - t_s) > GAP_S) continue;
      for (let joint = 0; joint < rows; joint++) {
        const angle = sample.measured[joint] ?? NaN;
        if (Number.isNaN(angle)) continue;
        const share = Math.max(-1, Math.min(1, angle / reach));
        const end = share < 0 ? low : high;
        const pixel = 4 * ((rows - 1 - joint) * this.columns + column);
        for (let c = 0; c < 3; c++) {
          const from = zero[c] ?? 0;
          image.data[pixel + c] = from + ((end[c] ?? 0) - from) * Math.abs(share);
        }
        image.data[pixel + 3] = 255;
      }
    }
    context.putImageData(image, 0, 0);
    return reach;
  }

  private reach(history: JointHistory): number {
    let largest = 5;
    for (let index = 0; index < history.samples.length; index += 8) {
      for (const angle of history.samples[index]?.measured ?? []) if (angle > largest || -angle > largest) largest = Math.abs(angle);
    }
    return Math.ceil(largest / 5) * 5;
  }
}
