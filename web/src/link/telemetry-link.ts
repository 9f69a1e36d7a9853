// What the page and its telemetry worker say to each other, and the form of a camera frame.

import type { Colours } from "../drawing/painter";
import type { Frame, ShownImage, TelemetryMessage } from "../types";

/** What the worker hands on to the page. */
export type Message = Extract<TelemetryMessage, { type: "state" | "tick" | "event" }>;

export type ToWorker =
  | { kind: "connect"; url: string }
  | { kind: "draw"; image: OffscreenCanvas; overlay: OffscreenCanvas }
  | { kind: "mark"; shown: boolean; colours: Colours }
  | { kind: "level"; level: boolean }
  | { kind: "clear" };

export type FromWorker =
  | { kind: "open" }
  | { kind: "closed"; reason: string }
  | { kind: "message"; message: Message }
  | { kind: "round-trip"; ms: number | null }
  | { kind: "image"; image: ShownImage };

const FRAME_KIND = 1;

/** One byte kind, a little-endian uint32 length, that much JSON, then the JPEG. */
export function parseFrame(buffer: ArrayBuffer): Frame | null {
  const view = new DataView(buffer);
  if (buffer.byteLength < 5 || view.getUint8(0) !== FRAME_KIND) return null;
  const length = view.getUint32(1, true);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 5, length))) as Omit<Frame, "jpeg">;
  return { ...header, jpeg: new Uint8Array(buffer, 5 + length) };
}
