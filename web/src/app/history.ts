// The last seconds of every joint, commanded and measured.

import type { App } from "./app";
import type { Tick } from "../types";

export interface Sample {
  t_s: number;
  target: Float32Array;
  measured: Float32Array;
}

/** Ticks come many times a second: over a longer time nothing is known, and nothing may be drawn. */
export const GAP_S = 0.5;

const DEG = 180 / Math.PI;
const degrees = (radians: number[]): Float32Array => Float32Array.from(radians, (angle) => angle * DEG);

/** Call the listener before the first tick after a gap is passed on to those who listen from now on. */
export function onGap(app: App, listener: () => void): void {
  let before_s: number | null = null;
  app.tick.on(({ t_s }) => {
    if (before_s !== null && Math.abs(t_s - before_s) > GAP_S) listener();
    before_s = t_s;
  });
}

export class JointHistory {
  readonly samples: Sample[] = [];
  joints = 0;
  private seeks = 0;

  constructor(readonly window_s: number) {}

  /** Keep one tick; a jump in time (a new session, a seek) or another robot starts afresh. */
  push(tick: Tick): void {
    const last = this.samples[this.samples.length - 1];
    const seeks = tick.playback?.seeks ?? 0;
    if (tick.q_measured.length !== this.joints || seeks !== this.seeks || (last && tick.t_s < last.t_s)) this.clear();
    this.seeks = seeks;
    this.joints = tick.q_measured.length;
    if (last && this.samples.length > 0 && tick.t_s === last.t_s) return;
    if (last && this.samples.length > 0 && tick.t_s - last.t_s > GAP_S) this.samples.push(this.unknown(last.t_s + GAP_S / 2));
    this.samples.push({ t_s: tick.t_s, target: degrees(tick.q_target), measured: degrees(tick.q_measured) });
    while ((this.samples[0]?.t_s ?? tick.t_s) < tick.t_s - this.window_s) this.samples.shift();
  }

  /** A sample that ends the lines before a gap: every angle is NaN. */
  private unknown(t_s: number): Sample {
    const none = new Float32Array(this.joints).fill(NaN);
    return { t_s, target: none, measured: none };
  }

  clear(): void {
    this.samples.length = 0;
  }

  get end_s(): number {
    return this.samples[this.samples.length - 1]?.t_s ?? 0;
  }
}
