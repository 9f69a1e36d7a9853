// The gaits' own formulas, for the small moving drawings:
// alpha(n, t) = A_o sin(k_o n + w_o t) for odd joints (yaw), A_e sin(k_e n + w_e t + delta) for even ones (pitch).
// Joints count from tail to head; one joint length is 1.

import type { ParameterValues } from "./types";

export type Vec3 = [number, number, number];
/** A shape in its own level frame: joint positions and how far each link's back is turned up (1) or down (-1). */
export interface Shape {
  points: Vec3[];
  backs: number[];
}

interface Waves {
  yawAmplitude: number;
  pitchAmplitude: number;
  yawK: number;
  pitchK: number;
  pitchRate: number;
  phase: number;
}

const RAD = Math.PI / 180;

function waves(name: string, values: ParameterValues): Waves {
  const k = (2 * Math.PI) / (values.wavelength_joints ?? 16);
  const amplitude = (values.amplitude_deg ?? 15) * RAD;
  const base = { yawK: k, pitchK: k, pitchRate: 1, phase: Math.PI / 2 };
  switch (name) {
    case "serpentine":
      return { ...base, yawAmplitude: 2 * (values.alpha_pi ?? 0.3) * Math.PI * Math.sin(k), pitchAmplitude: 0 };
    case "sidewinding":
      return { ...base, yawAmplitude: amplitude, pitchAmplitude: amplitude / 2 };
    case "arc_rolling":
      return { ...base, yawAmplitude: amplitude, pitchAmplitude: amplitude, yawK: 0, pitchK: 0 };
    case "pedal":
      return { ...base, yawAmplitude: amplitude, pitchAmplitude: amplitude / 3, pitchK: 2 * k, pitchRate: 2 };
    default:
      return { ...base, yawAmplitude: amplitude, pitchAmplitude: amplitude };
  }
}

/** Joint angles in rad, tail to head, at a phase (w t) in rad. */
export function jointAngles(name: string, values: ParameterValues, joints: number, phase: number): number[] {
  const w = waves(name, values);
  return Array.from({ length: joints }, (_, index) => {
    const n = index + 1;
    if (n % 2 === 1) return w.yawAmplitude * Math.sin(w.yawK * n + phase);
    return w.pitchAmplitude * Math.sin(w.pitchK * n + w.pitchRate * phase + w.phase);
  });
}

const combine = (a: number, u: Vec3, b: number, v: Vec3): Vec3 => [
  a * u[0] + b * v[0],
  a * u[1] + b * v[1],
  a * u[2] + b * v[2],
];
const dot = (u: Vec3, v: Vec3): number => u[0] * v[0] + u[1] * v[1] + u[2] * v[2];
const cross = (u: Vec3, v: Vec3): Vec3 => [
  u[1] * v[2] - u[2] * v[1],
  u[2] * v[0] - u[0] * v[2],
  u[0] * v[1] - u[1] * v[0],
];
const unit = (u: Vec3): Vec3 => combine(1 / (Math.hypot(...u) || 1), u, 0, u);

/** Forward kinematics from the tail: positions and each link's upward axis, in the tail's frame. */
function chain(angles: number[]): { points: Vec3[]; ups: Vec3[] } {
  let x: Vec3 = [1, 0, 0];
  let y: Vec3 = [0, 1, 0];
  let z: Vec3 = [0, 0, 1];
  let point: Vec3 = [0, 0, 0];
  const points: Vec3[] = [point];
  const ups: Vec3[] = [z];
  angles.forEach((angle, index) => {
    point = combine(1, point, 1, x);
    const c = Math.cos(angle);
    const s = Math.sin(angle);
    if (index % 2 === 0) [x, y] = [combine(c, x, s, y), combine(c, y, -s, x)];
    else [x, z] = [combine(c, x, s, z), combine(c, z, -s, x)];
    points.push(point);
    ups.push(z);
  });
  points.push(combine(1, point, 1, x));
  ups.push(z);
  return { points, ups };
}

/** The direction in which points about their mean spread most, by power iteration from a guess. */
function spread(points: Vec3[], guess: Vec3, without: Vec3 | null): Vec3 {
  let axis = guess;
  for (let round = 0; round < 24; round++) {
    let next: Vec3 = [0, 0, 0];
    for (const p of points) next = combine(1, next, dot(p, axis), p);
    if (without) next = combine(1, next, -dot(next, without), without);
    if (Math.hypot(...next) < 1e-9) return axis;
    axis = unit(next);
  }
  return axis;
}

/** Poses a gait's shape level on the ground, keeping its axes continuous from one call to the next. */
export class Poser {
  private side: Vec3 = [0, 1, 0];

  pose(angles: number[]): Shape {
    const { points, ups } = chain(angles);
    const mean = points.reduce((sum, p) => combine(1, sum, 1 / points.length, p), [0, 0, 0] as Vec3);
    const centred = points.map((p) => combine(1, p, -1, mean));
    const tailToHead = unit(combine(1, centred[centred.length - 1] ?? mean, -1, centred[0] ?? mean));
    const ahead = spread(centred, tailToHead, null);
    const forward = dot(ahead, tailToHead) < 0 ? combine(-1, ahead, 0, ahead) : ahead;
    const guess = unit(combine(1, this.side, -dot(this.side, forward), forward));
    const side = spread(centred, guess, forward);
    this.side = dot(side, guess) < 0 ? combine(-1, side, 0, side) : side;
    const up = cross(forward, this.side);
    const level = centred.map((p): Vec3 => [dot(p, forward), dot(p, this.side), dot(p, up)]);
    const ground = Math.min(...level.map((p) => p[2]));
    return {
      points: level.map(([px, py, pz]): Vec3 => [px, py, pz - ground]),
      backs: ups.map((u) => dot(u, up)),
    };
  }
}

/** The Bessel function J0, by its series: how much of the wave's speed an ideal serpenoid body advances. */
export function besselJ0(x: number): number {
  let term = 1;
  let sum = 1;
  for (let m = 1; m < 30; m++) {
    term *= -(x * x) / (4 * m * m);
    sum += term;
  }
  return sum;
}
